"""Plant: the simulated hopper that is steered where there is no robot."""
