"""Cases at the edges of the time span: on a guard at t0, at t_end, tiny spans, a huge t0."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from hybrid_systems import throw
from stress_case import EPS, Case, Expected
from stress_gaps import additive, constant_case, turned
from stress_reference import Piecewise
from stress_systems import BOWL, POWER, clock, clock_params


def on_ceiling_case(speed: float, gravity: float, ceiling: float = 1.0) -> Case:
    """Return a ball that starts on the guard: rising, falling, or at rest with a bend."""
    end = 3.0
    back = 2 * speed / gravity if speed * gravity > 0 else end
    lock = 1 if speed > 0 or (speed == 0 and gravity < 0) else -1
    events = ((back, 0, -lock),) if 0 < back < end else ()
    last = -lock if events else lock
    y_end = (ceiling + speed * end - gravity * end * end / 2, speed - gravity * end)
    size = abs(speed) * end + abs(gravity) * end * end
    off = 32 * EPS * (size + ceiling)
    answer = Expected(events, y_end, off / max(abs(speed), 1.0), off, mode=(last,))
    return Case("on_guard_at_start", f"rate {speed:g}, bend {-gravity:g}, h {ceiling:g}", throw(),
                (0.0, end), (ceiling, speed), (answer,),
                {"params": (gravity, ceiling)})  # fmt: skip


def given_lock_case(lock: int, place: float) -> Case:
    """Return a lock that contradicts h (the event is due at once) or agrees with it (no event)."""
    params = clock_params([(POWER, 1.0, 1, 1.0)], [1.0])
    sign = 1 if place >= 1.0 else -1
    events = () if lock == sign else ((0.0, 0, sign),)
    crossing = 1.0 - place
    if crossing > 0:
        events = (*events, (crossing, 0, 1))
    z_end = 0.5 - max(crossing, 0.0)
    answer = Expected(events, (place + 0.5, z_end), 32 * EPS, 32 * EPS, mode=(1,))
    return Case("lock_given", f"{lock:+d} at x = {place:g}", clock(1), (0.0, 0.5), (place, 0.0),
                (answer,), {"params": params, "mode": (lock,)})  # fmt: skip


def flat_start_case(
    kind: tuple[float, float, float, float], lock: int, name: str
) -> Case:
    """Return a start on the guard with zero rate: the second or a higher derivative decides."""
    answer = Expected((), (3.0, 2.0 * (lock > 0)), 0.0, 64 * EPS, mode=(lock,))
    return Case("flat_at_start", name, clock(1), (0.0, 2.0), (1.0, 0.0), (answer,),
                {"params": clock_params([kind], [1.0])})  # fmt: skip


def several_at_start_case(angle: float) -> Case:
    """Return five guards through the initial state: two rise, two fall, one is never left."""
    turn, _ = turned(angle, (0.0, 0.0))
    normals = (
        np.array([[1.0, 0.0], [0.8, 0.6], [-1.0, 0.0], [-0.6, -0.8], [1.0, 0.0]])
        @ turn.T
    )
    fields = additive((0.5, -0.25, 0.0, 0.75, -0.5)) @ turn.T
    system = Piecewise(np.zeros(5), normals, fields)
    return constant_case(
        "several_at_start", f"turned {angle:g}", system, np.zeros(2), (0.0, 2.0)
    )


def span_end_case(ulps: int, at: float) -> Case:
    """Return an event a few ulps from t_end; it counts if it is not later than t_end."""
    end = at
    for _ in range(abs(ulps)):
        end = float(np.nextafter(end, np.inf if ulps > 0 else -np.inf))
    params = clock_params([(POWER, at, 1, 1.0)], [1.0])
    found = Expected(
        ((at, 0, 1),), (end, max(end - at, 0.0)), 8 * EPS * at, 8 * EPS * at, mode=(1,)
    )
    none = replace(found, events=(), mode=(-1,))
    answers = (found,) if ulps >= 0 else (none,) if ulps <= -8 else (found, none)
    return Case("event_at_end", f"{at:g}, end {ulps:+d} ulp", clock(1), (0.0, end), (0.0, 0.0),
                answers, {"params": params})  # fmt: skip


def tiny_span_case(start: float, span: float, share: float) -> Case:
    """Return a very small span with an event at this fraction of it (above 1: beyond it)."""
    end = start + span
    at = share * span
    params = clock_params([(POWER, at, 1, 1.0)], [1.0])
    span = end - start
    within = at < span
    events = ((start + at, 0, 1),) if within else ()
    z_end = span - at if within else 0.0
    off = 8 * EPS * max(span, abs(start))
    answer = Expected(events, (span, z_end), off, off, mode=(1,) if within else (-1,))
    early = Expected(((end, 0, 1),), (span, 0.0), off, off, mode=(1,))
    near = abs(at - span) < 4 * EPS * start  # closer to the end than times can resolve
    answers = (
        (answer, early, replace(early, events=(), mode=(-1,))) if near else (answer,)
    )
    return Case("tiny_span", f"{span:g} from {start:g}, event at {share:g}", clock(1), (start, end),
                (0.0, 0.0), answers, {"params": params})  # fmt: skip


def huge_start_case(start: float) -> Case:
    """Return a clock and three guards far from t = 0, where times are as exact as floats."""
    params = clock_params(
        [(POWER, a, 1, 1.0) for a in (0.5, 1.0, 1.25)], [1.0, -0.5, 0.25]
    )
    events = tuple((start + a, k, 1) for k, a in enumerate((0.5, 1.0, 1.25)))
    off = 16 * EPS * start
    z_end = 1.5 - 0.5 + 0.25 * 0.75
    answer = Expected(events, (2.0, z_end), off, 3 * off, mode=(1, 1, 1))
    return Case("huge_start", f"{start:g}", clock(3), (start, start + 2.0), (0.0, 0.0), (answer,),
                {"params": params})  # fmt: skip


def never_case(name: str, kind: tuple[float, float, float, float], lock: int) -> Case:
    """Return a guard that is never reached."""
    answer = Expected((), (3.0, 3.0 * (lock > 0)), 0.0, 32 * EPS, mode=(lock,))
    return Case("never_reached", name, clock(1), (0.0, 3.0), (0.0, 0.0), (answer,),
                {"params": clock_params([kind], [1.0])})  # fmt: skip


def edge_cases() -> list[Case]:
    """Return all cases of this module."""
    flat: Callable[..., Case] = flat_start_case
    return [
        *(on_ceiling_case(v, g, p) for v in (1.0, -1.0, 0.0) for g in (2.0, -2.0)
          for p in (1.0, 0.0)),
        *(given_lock_case(lock, place) for lock in (1, -1) for place in (0.75, 1.0, 1.25)),
        *(
            flat((POWER, 1.0, power, sign), int(sign), f"{sign:+g} x^{power}")
            for power in (2, 3, 4) for sign in (1.0, -1.0)
        ),
        flat((BOWL, 1.0, 1e-12, 0.0), 1, "1e-12 x^2"),
        flat((BOWL, 1.0, -1e12, 0.0), -1, "-1e12 x^2"),
        *(several_at_start_case(angle) for angle in (0.0, 0.3)),
        *(span_end_case(ulps, at) for at in (1.0, 0.7) for ulps in (-16, -8, -2, -1, 0, 1, 2, 8)),
        *(tiny_span_case(0.0, span, share) for span in (1e-3, 1e-12, 1e-100, 1e-290)
          for share in (0.5, 2.0)),
        tiny_span_case(0.0, 5e-324, 2.0),
        *(tiny_span_case(1.0, span, share) for span in (1e-9, 1e-13, EPS) for share in (0.5, 2.0)),
        *(huge_start_case(start) for start in (1e3, 1e6, 1e9, 1e12)),
        never_case("far", (POWER, 1e6, 1, 1.0), -1),
        never_case("behind", (POWER, -1e-9, 1, 1.0), 1),
        never_case("level", (BOWL, 0.0, 0.0, 1.0), -1),
        never_case("just beyond the end", (POWER, 3.0 + 1e-12, 1, 1.0), -1),
    ]  # fmt: skip
