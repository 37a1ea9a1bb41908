"""One file a command: its options and its work. `gash_jax.apps.cli` imports a file when its command is called."""
