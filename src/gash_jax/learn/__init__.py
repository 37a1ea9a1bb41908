"""Data, models and objectives meet here: configs, corpus, losses, metrics, training."""
