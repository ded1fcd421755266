"""Recordings: the one form in which motion capture enters the analysis, and its readers."""
