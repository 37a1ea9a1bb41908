"""Rays, transfer, light, shading: the physics. Knows no network."""
