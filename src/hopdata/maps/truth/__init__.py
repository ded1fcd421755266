"""Scores of a simulated study against the truth: maps, landings, scaling study."""
