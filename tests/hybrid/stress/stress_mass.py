"""A mass on a floor with spring and damper: stiff, damped, many hops, other units."""

from __future__ import annotations

from functools import cache
from typing import Any

import mpmath
import numpy as np
from stress_case import EPS, Case, Expected
from stress_systems import mass

GRAVITY = 9.81
RTOL, ATOL = 1e-11, 1e-14
STEPS_PER_PHASE = 100  # of one flight or stance, at RTOL: more than the method takes
STATE = tuple[Any, Any]


def flight(y: STATE, t: Any) -> STATE:
    """Return height and velocity after a time in the air."""
    return y[0] + y[1] * t - GRAVITY * t * t / 2, y[1] - GRAVITY * t


def stance(y: STATE, k: Any, c: Any, t: Any) -> STATE:
    """Return height and velocity after a time on spring and damper (both per mass)."""
    rest, half = -mpmath.mpf(GRAVITY) / k, mpmath.mpf(c) / 2
    root = mpmath.sqrt(half * half - k)  # imaginary if the mass oscillates
    x, v = y[0] - rest, y[1]
    one, two = -half + root, -half - root
    a, b = (v - two * x) / (2 * root), (one * x - v) / (2 * root)
    first, second = a * mpmath.exp(one * t), b * mpmath.exp(two * t)
    return mpmath.re(rest + first + second), mpmath.re(one * first + two * second)


def lift_off(y: STATE, k: Any, c: Any) -> Any:
    """Return how long the mass stays on the floor; None if for good."""
    half = mpmath.mpf(c) / 2
    if half * half >= k:
        return None
    omega = mpmath.sqrt(k - half * half)
    # The velocity e^(-half t) (v cos + q sin) is zero at the lowest point and half a
    # period later.
    q = (-GRAVITY - k * y[0] - half * y[1]) / omega
    lowest = mpmath.atan2(y[1], -q) / omega
    lowest = lowest if lowest > 0 else lowest + mpmath.pi / omega
    top = lowest + mpmath.pi / omega
    if stance(y, k, c, top)[0] <= 0:
        return None
    height = lambda t: stance(y, k, c, t)[0]  # noqa: E731
    t = mpmath.findroot(height, (lowest, top), solver="anderson", tol=1e-30)
    for _ in range(3):  # Newton's method doubles the digits, down to the last ones
        at = stance(y, k, c, t)
        t -= at[0] / at[1]
    return t


@cache
def hops(
    k: float, c: float, height: float, end: float
) -> tuple[tuple[Any, ...], STATE]:
    """Return the instants of contact and lift-off in turn, and the final state."""
    with mpmath.workdps(40):
        y, now, instants = (mpmath.mpf(height), mpmath.mpf(0)), mpmath.mpf(0), []
        in_air = True
        while True:
            if in_air:
                wait = (y[1] + mpmath.sqrt(y[1] ** 2 + 2 * GRAVITY * y[0])) / GRAVITY
            else:
                wait = lift_off(y, k, c)
            if wait is None or now + wait > end:
                y = flight(y, end - now) if in_air else stance(y, k, c, end - now)
                return tuple(instants), y
            y = flight(y, wait) if in_air else stance(y, k, c, wait)
            y = (mpmath.mpf(0), y[1])
            now, in_air = now + wait, not in_air
            instants.append(now)


def mass_case(
    name: str, k: float, c: float, end: float = 2.0, length: float = 1.0, time: float = 1.0,
    **options: Any,
) -> Case:  # fmt: skip
    """Drop the mass by 1 m; lengths and times may be in other units.

    Errors of the steps add up: RTOL per step in height and speed. Each error of the
    speed shifts the remaining flights by the same amount.
    """
    instants, y = hops(k, c, 1.0, end)
    events = tuple(
        (float(t) * time, 0, 1 if j % 2 == 0 else -1) for j, t in enumerate(instants)
    )
    phases = len(instants) + 1
    part = STEPS_PER_PHASE * RTOL * phases * (1 + end)
    unit = np.array([length, length / time])
    speed = np.sqrt(2 * GRAVITY)
    options = {"rtol": RTOL, "atol": ATOL * unit, **options}
    scaled = (GRAVITY * length / time**2, k / time**2, c / time)
    answer = Expected(
        events, np.array([float(y[0]), float(y[1])]) * unit, part * time,
        part * np.array([speed, max(GRAVITY, speed * _jerk(k, y))]) * unit,
        mode=(1 if len(instants) % 2 else -1,),
    )  # fmt: skip
    parameter = (
        f"k/m {k:g}, c/m {c:g}, length {length:g}, time {time:g}{_said(options)}"
    )
    return Case(name, parameter, mass(), (0.0, end * time), np.array([1.0, 0.0]) * unit, (answer,),
                {"params": scaled, **options})  # fmt: skip


def _jerk(k: float, y: STATE) -> float:
    """Return the rate of change of the velocity in the final phase, in units of the speed."""
    return float(mpmath.sqrt(k)) if y[0] < 0 else 1.0


def _said(options: dict[str, Any]) -> str:
    return ", atol 0" if np.all(np.asarray(options["atol"]) == 0.0) else ""


def mass_cases() -> list[Case]:
    """Return all cases of this module."""
    stiff = [10.0**power for power in (0, 1, 2, 3, 4, 6, 8, 10, 12)]
    damped = [(1e3, 10.0), (1e6, 1e2), (1e6, 1.9e3), (1e3, 1e4), (1e12, 1e3)]
    units = [(1e-9, 1.0), (1e9, 1.0), (1.0, 1e-9), (1.0, 1e9), (1e-9, 1e9), (1e9, 1e-9)]
    return [
        *(mass_case("stiff", k, 0.0) for k in stiff),
        *(mass_case("damped", k, c) for k, c in damped),
        mass_case("damped", 1e12, 1e6, max_steps=2_000_000),
        mass_case("damped", 1e3, 1e6, end=0.5),
        mass_case("damped", 1e6, 1e6, end=0.5),
        *(mass_case("units", 1e3, 1.0, length=a, time=b) for a, b in units),
        *(mass_case("units", 1e3, 1.0, length=a, time=b, atol=0.0) for a, b in units),
    ]


def undamped_period(k: float, height: float) -> float:
    """Return the time from apex to apex."""
    speed = np.sqrt(2 * GRAVITY * height)
    omega = np.sqrt(k)
    return float(2 * speed / GRAVITY + 2 * np.arctan2(speed * omega, -GRAVITY) / omega)


def energy(k: float, y: np.ndarray) -> np.ndarray:
    """Return the energy per mass of states (2, ...)."""
    return y[1] ** 2 / 2 + GRAVITY * y[0] + k * np.minimum(y[0], 0.0) ** 2 / 2


def long_case(count: int, k: float = 1e3, rtol: float = 1e-13) -> Case:
    """Return `count` hops of the undamped mass: contact, lift-off and apex at regular intervals.

    The last hop ends at an apex, whose height shows the remaining energy: an error of
    the period shifts the apex in time, and changes the height there only by its square.
    """
    period = undamped_period(k, 1.0)
    fall = np.sqrt(2 / GRAVITY)
    starts = period * np.arange(count)
    down, up = starts + fall, starts + period - fall
    events = [(float(t), 0, d) for pair in zip(down, up, strict=True)
              for t, d in zip(pair, (1, -1), strict=True)]  # fmt: skip
    per_hop = 2 * STEPS_PER_PHASE * max(rtol, 2 * EPS)
    part = per_hop * count
    late = part * period * count + 1e-15 * period * count**2
    answer = Expected(tuple(events), (1.0, 0.0), late, np.array([part + late**2 * GRAVITY,
                      (part + late) * GRAVITY]), mode=(-1,))  # fmt: skip
    return Case("long", f"{count} hops, rtol {rtol:g}", mass(), (0.0, period * count), (1.0, 0.0),
                (answer,), {"params": (GRAVITY, k, 0.0), "rtol": rtol, "atol": 1e-16,
                 "max_steps": 10 * per_hop_steps(count), "max_events": 4 * count})  # fmt: skip


def per_hop_steps(count: int) -> int:
    """Return an upper bound on the number of steps for `count` hops."""
    return 2 * STEPS_PER_PHASE * count
