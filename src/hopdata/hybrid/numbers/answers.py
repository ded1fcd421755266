"""What the guards' code for ranges and its caller share: a signature, and some memory.

The signature, in order: start and end of a piece (s), and the rate of time along it (1;
0 to vary the state alone); addresses of the ranges of states and of slopes, and their
number; address and length of the mode, and of the parameters; address of room for the
guards' ranges, and the number of guards; address of a list of guards, and its length;
address of the memory of answers.

Ranges stand in four rows: least, most, least rate, most rate.

The memory of answers has these slots of 8 bytes, integers first. A comparison that the
ranges leave open is counted in OPENED and takes the next bit of ANSWERS. A jump within
a range is counted in JUMPED, a kink in KINKED. LOST is set where no range can tell what
the code does, so that nothing is known of any guard. TIMED counts those of them whose
place has a known rate, other than zero: if the rates of the states are unknown, they
depend on the time alone. The others hold the range and the rate of what changes sign at
the first open comparison or jump, and at one that is counted in TIMED: the first, or
the one whose number the caller has written into WHICH. TIMED_KINK is 1 if that is a
kink only.
"""

from numba import types

from hopdata.hybrid.compiled.kernel import kernel

_FLOAT, _INT = types.float64, types.int64

RANGES_NATIVE = types.void(_FLOAT, _FLOAT, _FLOAT, *(12 * [_INT]))

# Number of guards to evaluate: those marked in a row of flags, of all.
CHOSEN = -1

OPENED, ANSWERS, JUMPED, KINKED, LOST, TIMED, WHICH = range(7)
N_INTEGERS = 7
FIRST_LEAST, FIRST_MOST, FIRST_LEAST_RATE, FIRST_MOST_RATE = range(7, 11)
TIMED_LEAST, TIMED_MOST, TIMED_LEAST_RATE, TIMED_MOST_RATE, TIMED_KINK = range(11, 16)
N_SLOTS = 16

#: Open comparisons along one path whose answers the caller chooses. Further ones are
#: answered at random, so that a loop that waits for an answer ends.
#: Unit: 1. Origin: derived: the answers are the bits of a positive integer.
N_ANSWERS = 62


@kernel
def next_answers(bits: int, opened: int) -> int:
    """Return the answers of the next path in order, or -1 after the last.

    The last of the `opened` comparisons that was answered no is answered yes, and those
    after it are forgotten.
    """
    place = opened - 1
    while place >= 0 and (bits >> place) & 1 == 1:
        place -= 1
    if place < 0:
        return -1
    return (bits & ((1 << place) - 1)) | (1 << place)
