"""The signature of the guards' code for ranges, which the driver calls by address.

In order: start and end of a piece (s); addresses of the ranges of states and of slopes,
and their number; address and length of the mode, and of the parameters; address of room
for the guards' ranges, and the number of guards; address of a list of guards, and its
length; address of the integer in which an open branch is noted.
"""

from numba import types

_FLOAT, _INT = types.float64, types.int64

RANGES_NATIVE = types.void(_FLOAT, _FLOAT, *(12 * [_INT]))
