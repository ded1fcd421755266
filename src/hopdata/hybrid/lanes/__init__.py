"""Many systems side by side, each in a lane of the processor's vectors, for `solve_batch`."""
