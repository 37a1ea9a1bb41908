"""Mesh and picture formats: bytes in, arrays out; `meshes` is the door through which every mesh comes in."""
