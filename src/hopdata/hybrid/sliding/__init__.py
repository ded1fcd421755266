"""Sliding along guards (Filippov): the derived system whose field may be a mix.

Where the fields on both sides of a guard's surface point at it, a solution can neither
cross nor stay on one side: it slides along the surface, at the rate of that convex
combination of the two fields which keeps the guard at zero (Filippov 1988). The share
of the upper field is a = r- / (r- - r+), with the guard's rates r- > 0 and r+ < 0 by
the lower and the upper field. The solution slides as long as 0 < a < 1, and leaves to
the side whose field lets go: upward at a = 1, where r+ = 0, downward at a = 0.

The driver knows nothing of this. The derived system has one more guard for each guard
that may slide, which comes before the user's: it grows through zero where the share
leaves the interval. Its handler decides at each flip whether the guard is crossed or
the solution begins to slide; the user's handler is told by the direction. While a guard
slides, its own function is hidden from the driver, because it is zero but for rounding,
and the user's functions are called with its lock at -1 and at +1; only the handler, and
the reader of a solution, see a lock of 0.

Its mode is longer: the locks of these guards, the user's mode, a flag for each guard
that may slide, and, with a law, the directions of all guards that are due. So are its
parameters, by OWN numbers at the end. For each guard that may slide these are the
direction of its reaction (only if guards may rest); then, for each, the value of its
function where it was let go; then, for each, the size of the state where it began to
slide or rest.

With several guards that slide at once, the field is taken as a sum: the field with all
their locks at -1, and for each lock a change that does not depend on the others. Then
one mix keeps all guards at zero. If the changes do depend on each other, there is a
family of mixes (Filippov's set allows them all), and the run ends with a status.
"""

from hopdata.hybrid.sliding.handler import no_handler
from hopdata.hybrid.sliding.records import Slides
from hopdata.hybrid.sliding.system import sliding_system

__all__ = ["Slides", "no_handler", "sliding_system"]
