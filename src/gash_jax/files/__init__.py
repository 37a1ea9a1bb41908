"""What touches the disk and the machine: whole files or none, npz archives, caches, cores."""
