"""Steering: from recorded hops to a model of the frame change, and a controller that uses it."""
