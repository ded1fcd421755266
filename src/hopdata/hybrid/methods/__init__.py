"""One module a method: how one step is taken, and its interpolant."""
