"""Experiments: trials in which a controller steers the simulated hopper."""
