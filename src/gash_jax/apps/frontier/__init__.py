"""Every method of `gash bench frontier`: ours in one table, and the other programs that it is timed beside."""
