"""Maps with what noise in the inputs and curvature do to them taken off."""
