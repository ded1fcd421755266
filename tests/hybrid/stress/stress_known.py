"""Cases that the integrator is known to fail, and how. Mend it, and take the line out."""

from __future__ import annotations

ZENO_AT_A_JUMP = (
    "a guard that jumps through zero fires there and back at once, then ends as Zeno (-7)"
)
ZENO_AT_THE_END = (
    "an event at t_end is located one unit short, fires there and back, and ends as Zeno (-7)"
)
ZENO_IN_A_CROWD = "guards within a few roundings fire there and back, and end as Zeno (-7)"
ZENO_AT_FAST = "a fast guard fires there and back at one instant, at times ending as Zeno (-7)"
ENDLESS_TOUCH = "steps of no length pile up before a flat touch: max_steps is reached"
FLAT_ROOT = "the root of x^5 is found 0.05 early, rounding of h explains 0.003"

# Seeds of the random systems: of 900 with piecewise constant fields, and of 100 with affine ones.
KNOWN_CONSTANT = (
    *(39, 83, 110, 119, 182, 217, 229, 231, 240, 259, 263, 274, 308, 316, 330, 340, 349, 353, 358),
    *(369, 412, 417, 473, 489, 517, 530, 541, 567, 648, 657, 739, 827, 840, 845, 896),
)
KNOWN_AFFINE = (99,)

KNOWN = {
    **{
        f"jump-{kind}": ZENO_AT_A_JUMP
        for kind in ("level, up", "level, down", "level, tiny", "level, huge",
                     "up against its slope", "up, then down by its slope")
    },
    "tiny_span-2.22045e-16 from 1, event at 0.5": ZENO_AT_THE_END,
    "tiny_span-2.22045e-16 from 1, event at 2": ZENO_AT_THE_END,
    "many_guards-100 within 1e-14": ZENO_IN_A_CROWD,
    **{
        f"fast_guard-{rate} Hz, of {what}": ZENO_AT_FAST
        for rate in (10, 20, 50) for what in ("time", "the state")
    },
    "handler-infinite": "a handler may set a state to infinity, and the status is 0",
    "spiral": "a Zeno spiral is called sliding (-6): the rates are of different modes",
    "jump-rising": "the crossing at a jump is put 0.37 off",
    "cut 2 ulp early": "steps of no length pile up before t_end: max_steps is reached",
    "flat_root-+1 x^4": ENDLESS_TOUCH,
    "flat_root--1 x^4": ENDLESS_TOUCH,
    "flat_root-+1 x^5": FLAT_ROOT,
    "flat_root--1 x^5": FLAT_ROOT,
}  # fmt: skip
