"""Graphs of a mesh: neighbour tables, encodings, batches; NumPy on the host, `jraph.GraphsTuple` as the type."""
