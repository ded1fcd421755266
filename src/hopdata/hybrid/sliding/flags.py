"""What is told of a guard that may slide, and what is remembered of it."""

# Directions in the log and for the handler, times the sign of the motion: +1 and -1
# cross the guard, +2 and -2 arrive from below and above and begin to slide, +3 and -3
# leave upward and downward.
SLIDES = 2
LEAVES = 3

# The handler brings the guard to rest, where its events pile up.
RESTS = 4

# Values of a flag: crossing as usual, sliding, resting, a mix that is not unique, and a
# guard that its handler does not turn back, which therefore cannot rest.
FREE = 0
SLIDING = 1
RESTING = 2
UNCLEAR = 3
STUCK = 4
