"""The flat vector of parameters that the hopper's compiled functions read: its indices.

Scalars come first, in the order of the fields of `HopperParameters`; then, for each
leg, its preload, the x and y of its rest foot and how much longer than usual it is;
then the numbers of a variant, if there is one (`hopdata.scenes.hopper_control`).
"""

N_LEGS = 0
GRAVITY = 1
MASS = 2
COUNTERWEIGHT = 3
INERTIA_X = 4
INERTIA_Y = 5
INERTIA_Z = 6
STIFFNESS = 7
DAMPING = 8
FRICTION = 9
SLIP_VELOCITY = 10
RELEASE_EXTENSION = 11
LEG_LENGTH = 12
BOOM_RADIUS = 13
BOOM_OFFSET = 14
BOOM_HEIGHT = 15
BOOM_ANGLE = 16
BOOM_SWING = 17
BOOM_START = 18
BOOM_DURATION = 19
TILT_LIMIT = 20

LEGS = 21  # the first leg's entries begin here
LEG_STRIDE = 4  # entries of a leg

# Entries of a leg, counted from its first.
PRELOAD = 0
FOOT_X = 1
FOOT_Y = 2
LONGER = 3
