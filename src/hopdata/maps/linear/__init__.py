"""Affine maps by least squares, their bootstrap, and the errors of their predictions."""
