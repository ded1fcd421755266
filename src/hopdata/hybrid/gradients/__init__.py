"""Gradients over events: by the start and all parameters in one backward pass."""

from hopdata.hybrid.gradients.adjoint import Gradient, gradient

__all__ = ["Gradient", "gradient"]
