"""Maps corrected for noise in the inputs and for curvature."""
