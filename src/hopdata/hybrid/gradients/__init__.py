"""Gradients over events: by the start and all parameters in one backward pass.

What a user calls, and what is made of his functions:

- `adjoint`: `gradient`: its arguments, the run, and the pass backward through it
- `extended`: the system that is run: all crossings logged, an integral as a state
- `run`: what the user gives and `solve` returns, as the pass reads it
- `tape`: numbers that record on a tape how they were computed
- `recorders`: machine code of the user's functions for such numbers

The pass backward, from what all of it uses to the whole:

- `workspace`: what it reads (a run) and where it writes; nothing is computed there
- `sweep`: numbers onto the tape, and the tape read backward
- `user_functions`: one call of field, guards or handler, recorded
- `losses`: the same for the functions of the end and of an event
- `replay`: forward once more: mode and parameters after each flip
- `step`: back from the end of a step to its start
- `known`, `jump`: where the field jumps in time, and back across it
- `surface`: back through the instant at which a guard met its surface
- `event`, `together`: back across the flips of one such guard, or of several
- `instant`: which of the two it is
- `backward`: the whole pass, row by row
"""

from hopdata.hybrid.gradients.adjoint import Gradient, gradient

__all__ = ["Gradient", "gradient"]
