"""Synthesis: a scene as a motion-capture system would see it, with its truth."""
