"""Recordings: the canonical form of motion-capture data, and its readers."""
