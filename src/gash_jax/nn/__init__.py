"""Networks that predict transfer from a graph (Flax linen); they know no mesh, no ray and no file."""
