"""Synthesis: a scene as a motion-capture system would see it, with its truth."""

from hopdata.synthesis.simulate import simulate_recording

__all__ = ["simulate_recording"]
