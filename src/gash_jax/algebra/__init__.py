"""The mathematics beneath every room: R(4,1), motors, spherical harmonics, direction sets, safe numerics."""
