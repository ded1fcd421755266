"""Figures of steering: the learned model, and runs of the steered hopper."""
