"""How an integration ended: codes as in SciPy (0 end, 1 event, negative failure) and words."""

from __future__ import annotations

FINISHED = 0
TERMINATED = 1
STEP_UNDERFLOW = -1
FIELD_NOT_FINITE = -2
GUARD_NOT_FINITE = -3
TOO_MANY_STEPS = -4
TOO_MANY_EVENTS = -5
SLIDING = -6
ZENO = -7
RESET_IN_JACOBIAN = -8
AFFINE_DIFFERS = -9
JACOBIAN_NOT_FINITE = -10
TIE_IN_JACOBIAN = -11
RATE_DIFFERS = -12

# Within the driver only.
RUNNING = 2
NEEDS_ROOM = 3
PAUSED = 4
NEEDS_METHOD = 5
BAD_START = 6
BAD_NUMBERS = 7

SENTENCES = {
    FINISHED: "The integration reached the end of t_span.",
    TERMINATED: "Event '{guard}' ended the integration at {at}.",
    STEP_UNDERFLOW: "The step fell below the spacing of floating-point times at {at}: "
    "the field is stiff or singular there, or the tolerance cannot be met.",
    FIELD_NOT_FINITE: "The field is NaN or infinite at, or directly after, {at}.",
    GUARD_NOT_FINITE: "Guard '{guard}' is NaN or infinite at, or directly after, {at}.",
    TOO_MANY_STEPS: "max_steps was reached at {at}.",
    TOO_MANY_EVENTS: "max_events was reached at {at}; the last was '{guard}'.",
    SLIDING: "Guard '{guard}' is not live at {at}: the field points into its surface from "
    "both sides (rates {below:+.6g} below and {above:+.6g} above, per second), so the "
    "trajectory would slide along it. Event-selected systems cross their guards.",
    ZENO: "Events pile up at {at}, the last of them '{guard}': the time between them falls "
    "below what floating-point numbers resolve (a Zeno sequence, or chattering).",
    TIE_IN_JACOBIAN: "Several guards flip at {at}, and their handlers change the field: how much "
    "of that belongs to which guard, and so the Jacobian of the flow, is not known.",
    JACOBIAN_NOT_FINITE: "The derivative of the field or the flow is NaN or infinite near {at}.",
    RATE_DIFFERS: "The rate hdot of guard '{guard}' is not that of its values h, up to {at}: "
    "correct @guards (a guard may jump and have kinks, but not everywhere).",
    AFFINE_DIFFERS: "The @affine function does not give the @field function's value at {at}: "
    "they must be the same field, in every mode.",
    RESET_IN_JACOBIAN: "The handler changed the state at {at}: the Jacobian of the flow is known "
    "only through events that leave it continuous.",
}


def describe(status: int, *, time: float, guard: str, rates: tuple[float, float]) -> str:
    """Say in a sentence how an integration ended.

    Parameters
    ----------
    status : int
        One of the codes of this module.
    time : float
        Where it ended, s.
    guard : str
        Name of the guard concerned, or an empty string.
    rates : tuple of float
        Rates of that guard's event function just before its last two flips, 1/s.
    """
    if status == FINISHED:
        return SENTENCES[status]
    below, above = rates
    return SENTENCES[status].format(at=f"t = {time:.17g}", guard=guard, below=below, above=above)
