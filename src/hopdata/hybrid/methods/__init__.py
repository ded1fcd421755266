"""Integration methods, one per module: how a step is taken, and its interpolant."""
