"""Scenes: vector fields with guards, ready for the hybrid integrator."""
