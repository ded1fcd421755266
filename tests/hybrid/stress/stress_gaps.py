"""Cases with events close together: contact gaps, pairs, pushes, many guards at one instant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from stress_case import EPS, Case, Expected
from stress_reference import Piecewise, constant_answer
from stress_systems import (
    PAIR,
    POWER,
    clock,
    clock_params,
    pushed_clock,
    selected,
    selected_params,
)

GAPS = (1e-3, 1e-6, 1e-9, 1e-12, 1e-13, 1e-14, 1e-15, 1e-16, 0.0)
RESOLUTION = 16 * EPS  # times closer than this, at 1 s, may be one instant
GAINS = {
    "faster": (0.5, 0.75, 1.0, 2.0),
    "slower": (-0.5, -0.2, -0.1, 0.3),
    "mixed": (3, -0.75, 1, 0),
}


def turned(angle: float, shift: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return a rotation and a new origin."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]]), np.array(shift)


def additive(gains: tuple[float, ...]) -> np.ndarray:
    """Return fields (2^K, 2): 1 plus the gains of the locks that are +1 along x, and 1 along y."""
    locks = [
        [row >> k & 1 for k in range(len(gains))] for row in range(1 << len(gains))
    ]
    return np.array([[1.0 + np.dot(bits, gains), 1.0] for bits in locks])


def constant_case(
    name: str, parameter: str, system: Piecewise, y0: np.ndarray, t_span: tuple[float, float],
    slack: float = 0.0, also: tuple[Expected, ...] = (),
) -> Case:  # fmt: skip
    """Return a case of piecewise constant fields with its exact answer."""
    params = selected_params(system.offsets, system.normals, system.constants)
    return Case(
        name, parameter, selected(*system.shape), t_span, y0,
        (constant_answer(system, y0.tolist(), t_span, slack=slack), *also), {"params": params},
    )  # fmt: skip


def gap_case(gap: float, kind: str, at: float, angle: float) -> Case:
    """Return four guards crossed within three gaps of each other, at x = `at`, rotated."""
    turn, origin = turned(angle, (0.0, 0.0))
    offsets = at + gap * np.array([2.0, 0.0, 3.0, 1.0])
    normals = np.tile(turn[:, 0], (4, 1))
    system = Piecewise(offsets, normals, additive(GAINS[kind]) @ turn.T)
    y0 = turn @ np.array([at - 1.0, 0.0]) + origin
    return constant_case(
        "contact_gap", f"{gap:g} {kind} at {at:g}", system, y0, (0.0, 3.0)
    )


def two_way_gap_case(gap: float) -> Case:
    """Return two-way guards: one of each pair rises, the other falls."""
    offsets = np.array([1.0, -(1.0 + gap), 1.0 + 2 * gap, -(1.0 + 3 * gap)])
    normals = np.array([[1.0, 0.0], [-1.0, 0.0]] * 2)
    system = Piecewise(offsets, normals, additive((0.5, -0.25, 0.75, -0.5)))
    return constant_case(
        "two_way_gap", f"{gap:g}", system, np.array([0.0, 0.0]), (0.0, 3.0)
    )


def recrossing_case(gap: float, angle: float) -> Case:
    """Return a case where guard 1, a gap after guard 0, turns the field back across guard 0."""
    turn, _ = turned(angle, (0.0, 0.0))
    fields = np.array([[1.0, 1.0], [1.0, 1.0], [-2.0, 1.0], [-2.0, 1.0]]) @ turn.T
    system = Piecewise(np.array([1.0, 1.0 + gap]), turn.T.copy(), fields)
    case = constant_case(
        "recrossing", f"{gap:g} turned {angle:g}", system, np.zeros(2), (0.0, 2.0)
    )
    if gap > RESOLUTION:
        return case
    exact = case.answers[0]
    only = tuple(event for event in exact.events if event[1] == 1)
    answers = (replace(exact, events=only), twice_crossed(exact))
    return replace(case, answers=(exact, *answers))


def twice_crossed(answer: Expected) -> Expected:
    """Return the answer with guard 0 also crossed there and back at the instant of guard 1."""
    instant = next(t for t, k, _ in answer.events if k == 1)
    events = ((instant, 0, 1), (instant, 1, 1), (instant, 0, -1))
    return replace(answer, events=events)


def pair_case(gap: float) -> Case:
    """Return one guard with two roots a gap apart: it falls and rises again."""
    params = clock_params([(PAIR, 1.0, gap, 1.0)], [2.0])
    rounding = 32 * EPS
    both = Expected(
        ((1.0, 0, -1), (1.0 + gap, 0, 1)),
        (3.0, 6.0 - 2 * gap),
        0.0,
        rounding,
        mode=(1,),
    )
    # If the rounding of h is as large as the dip, the times of the roots are uncertain
    # accordingly.
    depth, size = gap * gap / 4, 4.0
    blur = min(8 * EPS * size / gap, np.sqrt(8 * EPS * size))
    both = replace(
        both, time_tolerance=rounding + blur, state_tolerance=rounding + 4 * blur
    )
    none = replace(both, events=())
    answers = (both,) if depth > 8 * EPS * size else (both, none)
    return Case("pair_of_roots", f"{gap:g}", clock(1), (0.0, 3.0), (0.0, 0.0), answers,
                {"params": params})  # fmt: skip


def crowd_case(count: int, gap: float) -> Case:
    """Return many guards within `count` gaps."""
    places = 1.0 + gap * np.arange(count)[::-1]
    params = clock_params([(POWER, a, 1, 1.0) for a in places], [1.0 / count] * count)
    events = tuple((float(a), k, 1) for k, a in enumerate(places))
    z_end = float(np.mean(3.0 - places))
    answer = Expected(
        events, (3.0, z_end), 64 * EPS, 64 * EPS * count, mode=(1,) * count
    )
    return Case("many_guards", f"{count} within {gap * count:g}", clock(count), (0.0, 3.0),
                (0.0, 0.0), (answer,), {"params": params})  # fmt: skip


def push_case(
    amount: float, events: tuple[tuple[float, int, int], ...], parameter: str
) -> Case:
    """Return guards at 1, 2 and 3; the handler adds `amount` to x once, at the first crossing."""
    params = clock_params(
        [(POWER, a, 1, 1.0) for a in (1.0, 2.0, 3.0)], [1.0, 10.0, 100.0]
    )
    params = np.append(params, amount)
    up, z_end, end = {}, 0.0, 5.0
    for time, guard, direction in events:
        gain = 10.0**guard
        z_end += direction * gain * (end - time)
        up[guard] = direction
    mode = (*(up.get(k, -1) for k in range(3)), 1)
    answer = Expected(
        events, (end + amount, z_end), 64 * EPS, 64 * EPS * 300, mode=mode
    )
    return Case("handler_pushes", parameter, pushed_clock(3), (0.0, end), (0.0, 0.0), (answer,),
                {"params": params})  # fmt: skip


def push_cases() -> list[Case]:
    """Return handlers that push across other guards, onto one, back across their own, or hardly."""
    again = ((1.0, 0, 1), (1.0, 0, -1))
    return [
        push_case(1.5, ((1.0, 0, 1), (1.0, 1, 1), (1.5, 2, 1)), "across one"),
        push_case(2.5, ((1.0, 0, 1), (1.0, 1, 1), (1.0, 2, 1)), "across two"),
        push_case(1.0, ((1.0, 0, 1), (1.0, 1, 1), (2.0, 2, 1)), "onto one"),
        push_case(
            1.0 - 1e-12,
            ((1.0, 0, 1), (1 + 1e-12, 1, 1), (2 + 1e-12, 2, 1)),
            "just short",
        ),
        push_case(
            -0.5, (*again, (1.5, 0, 1), (2.5, 1, 1), (3.5, 2, 1)), "back across its own"
        ),
        push_case(
            -1e-9,
            (*again, (1 + 1e-9, 0, 1), (2 + 1e-9, 1, 1), (3 + 1e-9, 2, 1)),
            "back by 1e-9",
        ),
        push_case(0.0, ((1.0, 0, 1), (2.0, 1, 1), (3.0, 2, 1)), "nowhere"),
    ]


def terminal_case(gap: float, last: int) -> Case:
    """Return three guards `gap` apart with one terminal: those before or with it are events too."""
    terminal = tuple(k == last for k in range(3))
    params = clock_params([(POWER, 1.0 + k * gap, 1, 1.0) for k in range(3)], [1.0] * 3)
    seen = range(3) if gap == 0.0 else range(last + 1)
    events = tuple((1.0 + k * gap, k, 1) for k in seen)
    end = 1.0 + last * gap
    z_end = sum(end - time for time, _, _ in events)
    mode = tuple(1 if k in seen else -1 for k in range(3))
    answer = Expected(events, (end, z_end), 32 * EPS, 32 * EPS, status=1, mode=mode)
    return Case("terminal", f"guard {last} of 3, {gap:g} apart", clock(3, terminal), (0.0, 9.0),
                (0.0, 0.0), (answer,), {"params": params})  # fmt: skip


def gap_cases() -> list[Case]:
    """Return all cases of this module."""
    return [
        *(gap_case(gap, kind, at, angle) for gap in GAPS for kind in GAINS
          for at, angle in ((0.0, 0.0), (1.0, 0.0), (0.7, 0.3))),
        *(two_way_gap_case(gap) for gap in GAPS),
        *(recrossing_case(gap, angle) for gap in GAPS for angle in (0.0, 0.3)),
        *(pair_case(gap) for gap in (0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-12)),
        *(crowd_case(count, gap) for count in (2, 100) for gap in (0.0, 1e-16, 1e-14, 1e-9)),
        *push_cases(),
        *(terminal_case(gap, last) for gap in (0.0, 1e-12, 1e-3) for last in range(3)),
    ]  # fmt: skip
