"""Synthesis: a scene as seen by a motion-capture system, with its truth."""

from hopdata.synthesis.simulate import simulate_recording

__all__ = ["simulate_recording"]
