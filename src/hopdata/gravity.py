"""What falls: the one constant of nature that several rooms need."""

GRAVITY_M_S2 = 9.80665  # the standard acceleration of free fall (3rd CGPM, 1901)
