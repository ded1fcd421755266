"""Scores of a simulated study against the truth: exact maps, landings, and the scaling study."""
