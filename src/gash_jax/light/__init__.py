"""Environment light and what a surface makes of it."""
