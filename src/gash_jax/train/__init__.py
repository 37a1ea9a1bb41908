"""From a config to trained weights: corpus, objectives, the loop, checkpoints, sweeps."""
