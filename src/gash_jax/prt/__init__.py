"""Rays and transfer: the physics. Knows no network."""
