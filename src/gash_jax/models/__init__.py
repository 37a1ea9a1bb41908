"""Networks as things that are used: which there are, their graphs, weights, prediction."""
