"""How good and how fast: measures, references, timing, where a result comes from."""
