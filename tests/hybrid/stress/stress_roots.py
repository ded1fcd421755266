"""Cases with roots that are hard to see: grazing, touching, flat, jumping, and many in one step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hybrid_systems import throw
from stress_case import EPS, Case, Expected
from stress_systems import BOWL, JUMP, POWER, SINE, TIME, clock, clock_params, rotor

RTOL, ATOL = 1e-12, 1e-14
FIRST_ROOT = 0.004  # of a fast guard: less than half a period of the fastest
GRAZES = (1e-3, 1e-6, 1e-8, 1e-10, 1e-12, 1e-13, 1e-14, 1e-15)


def graze_case(delta: float, speed: float) -> Case:
    """Return a ball with a ceiling at (1 + delta) of its apex height; gravity 2 m/s2, 3 s."""
    gravity, end = 2.0, 1.5 * speed
    apex = speed * speed / (2 * gravity)
    ceiling = apex * (1.0 + delta)
    over = apex - ceiling  # exact: the two are within a factor of 2
    instant = speed / gravity
    y_end = np.array([speed * end - end * end, speed - gravity * end])
    size = np.array([apex, speed])
    off = 16 * (RTOL * np.abs(size).max() + ATOL)
    answers = (Expected((), y_end, 0.0, off, mode=(-1,)),)
    if over > 0.0:
        half = np.sqrt(2 * over / gravity)
        # An error of the height shifts the crossings by that error over the speed
        # there.
        moved = min(off / (gravity * half), np.sqrt(2 * off / gravity)) + 16 * EPS * end
        both = ((instant - half, 0, 1), (instant + half, 0, -1))
        answers = (Expected(both, y_end, moved, off, mode=(-1,)),)
    if abs(over) <= 64 * EPS * apex:  # then rounding decides
        twice = ((instant, 0, 1), (instant, 0, -1))
        unsure = Expected(twice, y_end, np.sqrt(512 * EPS) * instant, off, mode=(-1,))
        answers = (unsure, replace(unsure, events=()))
    return Case("grazing", f"{delta:+g}, {speed:g} m/s", throw(), (0.0, end), (0.0, speed), answers,
                {"params": (gravity, ceiling), "rtol": RTOL, "atol": ATOL})  # fmt: skip


def clock_case(
    name: str, parameter: str, kind: tuple[float, float, float, float],
    roots: list[float], first: int, blur: float = 0.0, end: float = 3.0, **options: float,
) -> Case:  # fmt: skip
    """Return one guard of a clock that starts at 0, with its roots; `first` is its initial lock.

    `blur` is how far rounding of h may move a root.
    """
    events, lock, since, z_end = [], first, 0.0, 0.0
    for root in [*roots, end]:
        z_end += (root - since) * (lock > 0)
        if root < end:
            lock, since = -lock, root
            events.append((root, 0, lock))
    off = (len(roots) + 1) * (64 * EPS * end + blur)
    answer = Expected(tuple(events), (end, z_end), off, off, mode=(lock,))
    return Case(name, parameter, clock(1), (0.0, end), (0.0, 0.0), (answer,),
                {"params": clock_params([kind], [1.0]), **options})  # fmt: skip


def touch_cases() -> list[Case]:
    """Return even powers that touch, odd ones that cross flat, bowls that barely dip or miss."""
    cases = []
    for power in (2, 3, 4, 5):
        for sign in (1.0, -1.0):
            odd = power % 2 == 1
            blur = 1.9 * (64 * EPS) ** (1.0 / power) if odd else 0.0
            first = -int(sign) if odd else int(sign)
            kind = (POWER, 1.1, power, sign)
            roots = [1.1] if odd else []
            cases.append(
                clock_case(
                    "flat_root", f"{sign:+g} x^{power}", kind, roots, first, blur
                )
            )
    for depth in (1e-2, 1e-6, 1e-9, 1e-12, 1e-14):
        half = float(np.sqrt(depth))
        blur, roots = 64 * EPS / half, [1.1 - half, 1.1 + half]
        cases.append(
            clock_case("bowl", f"{-depth:g}", (BOWL, 1.1, 1.0, depth), roots, 1, blur)
        )
        cases.append(clock_case("bowl", f"{depth:g}", (BOWL, 1.1, 1.0, -depth), [], 1))
    return cases


def jump_cases() -> list[Case]:
    """Return event functions that jump through zero: without slope, with it, and against it."""
    return [
        clock_case("jump", "level, up", (JUMP, 1.1, 1.0, 0.0), [1.1], -1),
        clock_case("jump", "level, down", (JUMP, 1.1, -1.0, 0.0), [1.1], 1),
        clock_case("jump", "rising", (JUMP, 1.1, 1.0, 0.5), [1.1], -1),
        clock_case("jump", "up against its slope", (JUMP, 1.1, 0.5, -0.25), [1.1], -1),
        clock_case(
            "jump", "up, then down by its slope", (JUMP, 1.1, 0.25, -0.5), [0.6, 1.1, 1.6], 1,
            max_step=0.2,
        ),
        clock_case("jump", "level, tiny", (JUMP, 1.1, 1e-12, 0.0), [1.1], -1),
        clock_case("jump", "level, huge", (JUMP, 1.1, 1e12, 0.0), [1.1], -1),
    ]  # fmt: skip


def fast_case(frequency: float, kind: int) -> Case:
    """Return a guard that oscillates while the state hardly moves; `max_step` has to reveal it."""
    roots = [FIRST_ROOT + k / (2 * frequency) for k in range(int(5.7 * frequency))]
    name = "of the state" if kind == SINE else "of time"
    return clock_case(
        "fast_guard", f"{frequency:g} Hz, {name}",
        (kind, FIRST_ROOT, 2 * np.pi * frequency, 0.0), roots,
        -1, 64 * EPS * frequency, end=roots[-1] + 0.25 / frequency, max_step=0.1 / frequency,
    )  # fmt: skip


def rotor_case(order: int, rate: float, rtol: float) -> Case:
    """Return a rotor whose guard is the cosine of `order` times its angle: many roots per turn."""
    end, gain = 6.0 / rate, 2.0
    roots = np.arange(0.5, order * rate * end / np.pi, 1.0) * np.pi / (order * rate)
    roots = roots[roots < end]
    events = tuple(
        (float(root), 0, -1 if k % 2 == 0 else 1) for k, root in enumerate(roots)
    )
    bounds = np.concatenate([[0.0], roots, [end]])
    up = float(np.diff(bounds)[::2].sum())
    y_end = np.array([np.cos(6.0), np.sin(6.0), end + gain * up])
    steps = (
        10 + 6.0 * (1e-3 / rtol) ** 0.2
    )  # an angle of about one over the root a step
    angle = steps * 2 * (rtol + rtol * 1e-2)
    off = np.array([angle, angle, (len(roots) + 1) * gain * angle / rate])
    lock = 1 if len(roots) % 2 == 0 else -1
    answer = Expected(events, y_end, angle / rate, off, mode=(lock,))
    return Case("rotor", f"cos {order} angle, rate {rate:g}, rtol {rtol:g}", rotor(), (0.0, end),
                (1.0, 0.0, 0.0), (answer,),
                {"params": (rate, order, gain), "rtol": rtol, "atol": rtol * 1e-2})  # fmt: skip


def root_cases() -> list[Case]:
    """Return all cases of this module."""
    deltas = [sign * delta for delta in GRAZES for sign in (1, -1)] + [0.0]
    return [
        *(graze_case(delta, speed) for delta in deltas for speed in (2.0, 3.7)),
        *touch_cases(),
        *jump_cases(),
        *(fast_case(rate, kind) for rate in (5.0, 10.0, 20.0, 50.0) for kind in (SINE, TIME)),
        *(rotor_case(order, rate, rtol) for order in (1, 3, 10, 20) for rate in (1.0, 1000.0)
          for rtol in (1e-6, 1e-9)),
    ]  # fmt: skip
