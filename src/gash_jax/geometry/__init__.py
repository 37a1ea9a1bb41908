"""Meshes as arrays: topology, orientation, normals, health."""
