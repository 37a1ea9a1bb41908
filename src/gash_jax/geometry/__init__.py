"""Triangle meshes on the host: reading, health, normals, orientation, procedural shapes."""
