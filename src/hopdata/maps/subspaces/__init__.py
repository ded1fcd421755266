"""Constraint subspaces of the mode schedules and the Grassmann distances between them."""
