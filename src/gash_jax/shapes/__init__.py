"""Shapes made by the project: primitives with known answers, and the procedural corpus."""
