"""Robots that are commanded once a stride: their interface, and simulated ones."""
