"""Guards that move faster than the state, or bend: random members of a table of families.

The path is known whatever the guards do: u = x + c, where x falls freely, c and s wind
in or out, and only z, the integral of the locks, depends on the events. So each
crossing is found by sampling the path densely and bracketing.
"""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
from scipy.optimize import brentq
from stress_case import EPS, Case, Expected

from hopdata.code_cache import kept_njit
from hopdata.hybrid import System, affine, field, guards, jacobian, on_event

SURFACE, SINE, BUMP, PRODUCT, POWER, ABSOLUTE, LARGER, TABLE, AFTER, PLANE = range(10)
WIDTH, FIXED = (
    12,
    3,
)  # length of a guard's row (kind, then its parameters); fall, growth, turn
KNOTS = 8  # of a table
SAMPLES = 40_000
MOST_CONTACTS = 24  # two events each; more would only be rounding
CLEAR = 2e-4  # of the guard's range: members closer to a turning point are left out
OFF = 10.0  # allowed error of a turning path, in tolerances
RTOLS = (1e-3, 1e-6, 1e-9, 1e-12)
METHODS = ("auto", "dopri5", "dop853", "taylor")


@kept_njit()
def height(q, t, u, v, du, dv, after):
    """Return an event function and its rate."""
    kind, a, b, c, d = int(q[0]), q[1], q[2], q[3], q[4]
    if kind == SURFACE:
        return u - a - b * np.sin(c * t + d), du - b * c * np.cos(c * t + d)
    if kind == SINE:
        return np.sin(b * u + c) - d, b * np.cos(b * u + c) * du
    if kind == BUMP:
        bump = a * np.exp(-0.5 * ((u - c) / b) ** 2)
        return bump - d, -bump * (u - c) / b**2 * du
    if kind == PRODUCT:
        return (u - a) * (v - b) * c, ((v - b) * du + (u - a) * dv) * c
    if kind == POWER:
        return b * (u - a) ** int(c), b * c * (u - a) ** int(c - 1) * du
    if kind == ABSOLUTE:
        return abs(u - a) - b, du if u >= a else -du
    if kind == LARGER:
        first, second = u - a, b - c * v
        return max(first, second), du if first >= second else -c * dv
    if kind == TABLE:  # values at equal distances a from d on; constant outside
        place = (u - d) / a
        k = int(np.floor(place))
        if k < 0 or k >= KNOTS - 2:
            return q[5] if k < 0 else q[5 + KNOTS - 2], 0.0
        rise = q[6 + k] - q[5 + k]
        return q[5 + k] + (place - k) * rise, rise / a * du
    if kind == AFTER and after > 0:
        return u - a - b * np.sin(c * t + d), du - b * c * np.cos(c * t + d)
    return u - a, du


@field
def quick_field(t, y, mode, params, dy):
    fall, growth, turn = params[0], params[1], params[2]
    dy[0], dy[1] = y[1], -fall
    dy[2], dy[3] = growth * y[2] - turn * y[3], turn * y[2] + growth * y[3]
    dy[4] = 0.0
    for k in range(2):
        dy[4] += (1.0 + k) * (mode[k] > 0)


@affine
def quick_affine(mode, params, a, b):
    a[0, 1], b[1] = 1.0, -params[0]
    a[2, 2], a[2, 3], a[3, 2], a[3, 3] = params[1], -params[2], params[2], params[1]
    for k in range(2):
        b[4] += (1.0 + k) * (mode[k] > 0)


@jacobian
def quick_jacobian(t, y, mode, params, jac):
    jac[0, 1] = 1.0
    jac[2, 2], jac[2, 3], jac[3, 2], jac[3, 3] = (
        params[1],
        -params[2],
        params[2],
        params[1],
    )


@guards
def quick_guards(t, y, dy, mode, params, h, hdot):
    for k in range(2):
        h[k], hdot[k] = height(
            params[FIXED + k * WIDTH : FIXED + (k + 1) * WIDTH], t, y[0] + y[2], y[1],
            dy[0] + dy[2], dy[1], mode[2],
        )  # fmt: skip


@on_event
def remember(t, y, mode, params, guard, direction):
    if guard == 0:
        mode[2] = 1
    return 0


@cache
def quick(affine_too: bool = False) -> System:
    """Return the system; with its affine form, Taylor's method supports it."""
    return System(
        quick_field, quick_guards, remember, n_states=5, guard_names=("g0", "g1"), n_extra_modes=1,
        jacobian=quick_jacobian, affine=quick_affine if affine_too else None,
    )  # fmt: skip


def place(params: np.ndarray, y0: np.ndarray, t: float) -> tuple[float, ...]:
    """Return u, v and their rates at one or many times, with the start at 0."""
    fall, growth, turn = params[:FIXED]
    grown, cosine, sine = np.exp(growth * t), np.cos(turn * t), np.sin(turn * t)
    c, s = (
        grown * (y0[2] * cosine - y0[3] * sine),
        grown * (y0[3] * cosine + y0[2] * sine),
    )
    v = y0[1] - fall * t
    u = y0[0] + y0[1] * t - 0.5 * fall * t * t + c
    return u, v, v + growth * c - turn * s, -fall + 0.0 * t


@lru_cache(1)
def path(
    fixed: tuple[float, ...], y0: tuple[float, ...], end: float
) -> tuple[np.ndarray, ...]:
    """Return times, u and v along the whole path, which all guards and shifts have in common."""
    t = np.linspace(0.0, end, SAMPLES + 1)
    return t, *place(np.array(fixed), np.array(y0), t)[:2]


@kept_njit()
def sampled(q, t, u, v, after_from):
    h = np.empty(len(t))
    for i in range(len(t)):
        h[i] = height(q, t[i], u[i], v[i], 0.0, 0.0, 1 if t[i] > after_from else 0)[0]
    return h


def crossings(
    params: np.ndarray,
    y0: np.ndarray,
    end: float,
    k: int,
    after_from: float,
    off: float,
) -> tuple[list[Event], int] | None:
    """Return the events of guard k and its lock at the start, if the path is shifted by `off`.

    The result is None if the guard turns near its surface.
    """
    q = params[FIXED + k * WIDTH : FIXED + (k + 1) * WIDTH]
    t, u, v = path(tuple(params[:FIXED]), tuple(y0), end)
    h = sampled(q, t, u + off, v, after_from)

    def at(instant: float) -> float:
        u, *rest = place(params, y0, instant)
        return float(
            height(q, instant, u + off, *rest, 1 if instant > after_from else 0)[0]
        )

    turns = np.flatnonzero(np.diff(np.sign(np.diff(h)))) + 1
    near = np.abs(h[[0, -1] if q[0] == POWER else [0, *turns, -1]])
    if near.min() <= (1e-9 if q[0] == POWER else CLEAR) * np.ptp(h):
        return None
    signs = np.sign(h)
    signs[signs == 0] = 1
    events = []
    for i in np.flatnonzero(signs[1:] != signs[:-1]):
        jumps = (
            t[i] <= after_from < t[i + 1]
            and at(after_from) * at(after_from + 1e-12) < 0
        )
        instant = (
            after_from
            if jumps
            else brentq(at, t[i], t[i + 1], xtol=1e-15, rtol=1e-14, maxiter=1000)
        )
        events.append((float(instant), k, int(signs[i + 1])))
    return events, int(signs[0])


def start(
    rng: np.random.Generator, *, turning: bool = False
) -> tuple[list[float], list[float]]:
    """Draw (fall, growth, turn) and a start: free flight, with or without a rotating state."""
    x, v = rng.uniform(-1.0, 1.0), rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 2.0)
    if not turning:
        return [rng.choice([0.0, rng.uniform(0.5, 9.81)]), 0.0, 0.0], [
            x,
            v,
            0.0,
            0.0,
            0.0,
        ]
    size = rng.uniform(0.3, 1.5)
    return [0.0, rng.uniform(-0.2, 0.1), rng.uniform(0.5, 4.0)], [
        x,
        0.3 * v,
        size,
        0.0,
        0.0,
    ]


def surface(rng, turning=False, kind=SURFACE):
    return [kind, rng.uniform(-0.5, 0.5), rng.uniform(0.05, 0.8), 10 ** rng.uniform(0.3, 2.0),
            rng.uniform(0.0, 6.0)]  # fmt: skip


def sine(rng):
    return [
        SINE,
        0.0,
        10 ** rng.uniform(0.3, 2.0),
        rng.uniform(0.0, 6.0),
        rng.uniform(-0.8, 0.8),
    ]


def bump(rng, width):
    return [
        BUMP,
        rng.uniform(0.5, 2.0),
        width,
        rng.uniform(-1.5, 1.5),
        rng.uniform(0.1, 0.4),
    ]


def product(rng):
    return [
        PRODUCT,
        rng.uniform(-1.0, 1.0),
        rng.uniform(-1.5, 1.5),
        rng.choice([-1.0, 1.0]),
    ]


def dip(rng):
    """Return a sine that reaches its surface only with its peaks."""
    return [SINE, 0.0, rng.uniform(2.0, 8.0), rng.uniform(0.0, 6.0),
            np.cos(rng.uniform(0.04, 0.2))]  # fmt: skip


def absolute(rng):
    return [ABSOLUTE, rng.uniform(-1.0, 1.0), rng.uniform(0.01, 0.6)]


def larger(rng):
    return [
        LARGER,
        rng.uniform(-0.5, 0.5),
        rng.uniform(-0.5, 0.5),
        rng.choice([-1.0, 1.0]),
    ]


def table(rng):
    return [TABLE, rng.uniform(0.02, 0.4), 0.0, 0.0, rng.uniform(-1.5, 1.0),
            *rng.uniform(-1.0, 1.0, KNOTS - 1)]  # fmt: skip


def flat(rng, power):
    return [POWER, rng.uniform(-1.0, 1.0), rng.choice([-1.0, 1.0]), power]


def plane(rng):
    return [PLANE, rng.uniform(-1.0, 1.0)]


Event = tuple[float, int, int]

# For each family: two guards, and whether the path turns.
FAMILIES = {
    "surface": (surface, surface, False),
    "surface, turning": (surface, plane, True),
    "sine of the state": (sine, plane, False),
    "sine of the state, turning": (sine, sine, True),
    "bump of 0.1": (lambda r: bump(r, 0.1), lambda r: bump(r, 0.1), False),
    "bump of 0.02": (lambda r: bump(r, 0.02), lambda r: bump(r, 0.02), False),
    "product": (product, product, False),
    "touch and part": (dip, dip, False),
    "x^3": (lambda r: flat(r, 3), plane, False),
    "x^5": (lambda r: flat(r, 5), plane, False),
    "abs": (absolute, absolute, False),
    "max": (larger, absolute, True),
    "table": (table, table, False),
    "after an event": (plane, lambda r: surface(r, kind=AFTER), False),
}


def history(
    params: np.ndarray, y0: np.ndarray, end: float, off: float = 0.0
) -> tuple[list[Event], tuple[int, int]] | None:
    """Return all events and the locks at the start; None if rounding might change them."""
    first = crossings(params, y0, end, 0, np.inf, off)
    if first is None:
        return None
    since = first[0][0][0] if first[0] else np.inf
    second = crossings(params, y0, end, 1, since, off)
    if second is None:
        return None
    events = sorted(first[0] + second[0])
    gaps = np.diff([t for t, _, _ in events])
    close = gaps[gaps > 0.0].min(initial=1.0) < 1e-5
    return None if close or not events else (events, (first[1], second[1]))


def end_state(
    params: np.ndarray,
    y0: np.ndarray,
    end: float,
    events: list[Event],
    locks: tuple[int, int],
) -> np.ndarray:
    """Return the final state: z is the integral of the locks."""
    c = np.exp(params[1] * end) * np.exp(1j * params[2] * end) * (y0[2] + 1j * y0[3])
    x = y0[0] + y0[1] * end - 0.5 * params[0] * end * end
    z, last, now = 0.0, 0.0, list(locks)
    for instant, k, direction in [*events, (end, 0, 0)]:
        z += (instant - last) * sum((1.0 + j) * (now[j] > 0) for j in range(2))
        last, now[k] = instant, direction
    return np.array([x, y0[1] - params[0] * end, c.real, c.imag, z])


def quick_member(family: str, rng: np.random.Generator, rtol: float) -> Case:
    """Draw a member of a family whose events also exist on a path with an error of `rtol`."""
    first, second, turning = FAMILIES[family]
    while True:
        fixed, y0 = start(rng, turning=turning)
        end = rng.uniform(1.0, 3.0)
        q = np.zeros((2, WIDTH))
        for row, numbers in zip(q, (first(rng), second(rng)), strict=True):
            row[: len(numbers)] = numbers
        params, state = np.concatenate([fixed, q.ravel()]), np.array(y0)
        right = history(params, state, end)
        if right is None:
            continue
        events, locks = right
        off = 1e-10
        for shift in (-OFF * rtol, OFF * rtol) if turning else ():
            other = history(params, state, end, shift)
            if other is None or [e[1:] for e in other[0]] != [e[1:] for e in events]:
                break
            off = max(
                off,
                *(2 * abs(a[0] - b[0]) for a, b in zip(other[0], events, strict=True)),
            )
        else:
            for t, k, _ in events:
                if (
                    q[k, 0] == POWER
                ):  # within the rounding of 1, or of its largest value
                    speed = abs(place(params, state, t)[2])
                    u = place(params, state, np.linspace(0.0, end, 100))[0]
                    largest = np.abs(u - q[k, 1]).max() ** q[k, 3]
                    small = max(3.0 ** q[k, 3] * 1e-14, EPS * largest)
                    off = max(off, small ** (1.0 / q[k, 3]) / speed)
            if off > 0.1:
                continue
            y_end = end_state(params, state, end, events, locks)
            state_off = np.array(
                [*[1e-9 + 100.0 * rtol * turning] * 4, 3.0 * len(events) * off]
            )
            answer = Expected(tuple(events), y_end, off, state_off + 1e-9)
            options = {"params": params, "rtol": rtol, "atol": 1e-3 * rtol}
            return Case(
                family, f"{rtol:g}", quick(), (0.0, end), y0, (answer,), options
            )


MEMBERS = 6  # per family and tolerance; `benchmarks/stress.py` takes 200


@cache
def members(family: str, rtol: float) -> list[Case]:
    """Return the members of a family that several tests share."""
    rng = np.random.default_rng([RTOLS.index(rtol), *map(ord, family)])
    return [quick_member(family, rng, rtol) for _ in range(MEMBERS)]


# params: restitution, amplitude, angular rate, phase of the table


@field
def fall_field(t, y, mode, params, dy):
    dy[0], dy[1] = y[1], -9.81


@guards
def table_guard(t, y, dy, mode, params, h, hdot):
    a, w, phase = params[1], params[2], params[3]
    h[0], hdot[0] = (
        a * np.sin(w * t + phase) - y[0],
        a * w * np.cos(w * t + phase) - dy[0],
    )


@on_event
def bounce(t, y, mode, params, guard, direction):
    if direction > 0:
        speed = params[1] * params[2] * np.cos(params[2] * t + params[3])
        y[1] = speed - params[0] * (y[1] - speed)
    return 0


@cache
def ball_on_table() -> System:
    return System(fall_field, table_guard, bounce, n_states=2, guard_names=("table",))


def bounces(
    params: np.ndarray, drop: float, end: float
) -> tuple[list[Event], np.ndarray] | None:
    """Return contacts and end of a released ball; None if it touches the table too gently."""
    e, a, w, phase = params
    t0, y, v, events = 0.0, drop, 0.0, []
    while True:
        t = np.linspace(0.0, end - t0, SAMPLES // 4 + 1)[1:]

        def gap(t, t0=t0, y=y, v=v):
            return y + v * t - 4.905 * t * t - a * np.sin(w * (t0 + t) + phase)

        h = gap(t)
        first = np.argmax(h < 0.0) if (h < 0.0).any() else len(h)
        inside = h[:first]
        turns = (inside[1:-1] < inside[:-2]) & (inside[1:-1] < inside[2:])
        if len(inside) < 3 or inside[1:-1][turns].min(initial=1.0) < 1e-4 * a:
            return None
        if first == len(h):
            fall = end - t0
            return events, np.array(
                [y + v * fall - 4.905 * fall * fall, v - 9.81 * fall]
            )
        fall = brentq(gap, t[first - 1], t[first], xtol=1e-15, rtol=1e-14)
        t0, y, v = t0 + fall, y + v * fall - 4.905 * fall * fall, v - 9.81 * fall
        speed = a * w * np.cos(w * t0 + phase)
        if speed - v < 0.05 or len(events) > MOST_CONTACTS:
            return None
        v = speed - e * (v - speed)
        events += [(t0, 0, 1), (t0, 0, -1)]


def table_member(rng: np.random.Generator, rtol: float) -> Case:
    """Draw a ball on a shaking table that it always hits with some speed."""
    while True:
        rate = rng.uniform(10.0, 60.0)
        params = np.array([rng.uniform(0.3, 0.9), 10.0 / rate**2 * rng.uniform(0.5, 5.0), rate,
                           rng.uniform(0.0, 6.0)])  # fmt: skip
        drop, end = params[1] + rng.uniform(0.1, 1.0), rng.uniform(1.0, 2.0)
        right = bounces(params, drop, end)
        if right is not None:
            answer = Expected(tuple(right[0]), right[1], 1e-6, 1e-5)
            options = {"params": params, "rtol": rtol, "atol": 1e-3 * rtol}
            return Case("shaking table", f"{rtol:g}", ball_on_table(), (0.0, end), (drop, 0.0),
                        (answer,), options)  # fmt: skip
