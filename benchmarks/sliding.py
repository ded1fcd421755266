"""Sliding beside a reference: random systems, their end states and derivatives.

Each member has two fields of three states, with tanh and sin, on the sides of a bent
surface that moves in time. The reference writes Filippov's sliding field out by hand
and steps through SciPy's events at 1e-12. Derivatives are compared with differences of
the flow, and with a smoothed system, in which the fields are blended over a layer about
the surface.

    python benchmarks/sliding.py --members 8 --seeds 11 12 13 14 15 --out sliding.csv
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp as reference_solve

from hopdata.hybrid import System, solve

N = 3
END = 6.0
FIELD = 2 * N * (N + 2)  # numbers of both fields
N_PARAMS = FIELD + 4


def field(t, y, mode, p):
    """Return the rates: a field of its own below (-1) and above (+1) the surface."""
    first = 0 if mode[0] < 0 else N * (N + 2)
    dy0 = p[first + 3] + p[first + 4] * np.sin(1.3 * t)
    dy1 = p[first + 8] + p[first + 9] * np.sin(1.3 * t)
    dy2 = p[first + 13] + p[first + 14] * np.sin(1.3 * t)
    for j in range(3):
        dy0 += p[first + j] * np.tanh(y[j])
        dy1 += p[first + 5 + j] * np.sin(y[j])
        dy2 += p[first + 10 + j] * np.tanh(y[j])
    return dy0, dy1, dy2


def surface(t, y, p):
    """Return the guard, a bent surface that moves."""
    bent = p[30] * y[1] * y[1] + p[31] * np.sin(y[2])
    return y[0] + bent + p[32] * np.sin(p[33] * t)


system = System(
    field, surface, n_states=N, guard_names=("surface",), sliding=("surface",)
)


def blended(t, y, p):
    """Return the rates of the smoothed system; the last parameter is its layer."""
    bent = p[30] * y[1] * y[1] + p[31] * np.sin(y[2])
    h = y[0] + bent + p[32] * np.sin(p[33] * t)
    share = 0.5 + 0.5 * np.tanh(h / p[34])
    out = np.zeros(3)
    for side in range(2):
        first = 15 * side
        weight = share if side == 1 else 1.0 - share
        for i in range(3):
            rate = p[first + 5 * i + 3] + p[first + 5 * i + 4] * np.sin(1.3 * t)
            for j in range(3):
                of = np.sin(y[j]) if i == 1 else np.tanh(y[j])
                rate += p[first + 5 * i + j] * of
            out[i] += weight * rate
    return out[0], out[1], out[2]


smooth = System(blended, n_states=N)


def member(seed: int, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Return start and parameters of a random member."""
    draw = np.random.default_rng(np.random.SeedSequence([seed, number]))
    p = np.zeros(N_PARAMS)
    p[:FIELD] = draw.normal(0.0, 0.8, FIELD)
    p[3] += 1.0  # the fields tend to point at the surface
    p[18] -= 1.0
    p[30:33] = draw.uniform(-0.6, 0.6, 3)
    p[33] = draw.uniform(0.5, 2.5)
    return draw.normal(0.0, 1.0, N), p


# The reference.


def by_hand(t: float, y: np.ndarray, lock: int, p: np.ndarray) -> np.ndarray:
    """Return the field of one side."""
    first = 0 if lock < 0 else 15
    rows = p[first : first + 15].reshape(3, 5)
    of = [np.tanh(y), np.sin(y), np.tanh(y)]
    rates = [rows[i, :3] @ of[i] for i in range(3)]
    return np.array(rates) + rows[:, 3] + rows[:, 4] * np.sin(1.3 * t)


def height(t: float, y: np.ndarray, p: np.ndarray) -> float:
    """Return the guard."""
    bent = p[30] * y[1] ** 2 + p[31] * np.sin(y[2])
    return float(y[0] + bent + p[32] * np.sin(p[33] * t))


def rates(t: float, y: np.ndarray, p: np.ndarray) -> tuple[float, float]:
    """Return the guard's rates by the lower and the upper field."""
    slope = np.array([1.0, 2.0 * p[30] * y[1], p[31] * np.cos(y[2])])
    moves = p[32] * p[33] * np.cos(p[33] * t)
    lower = slope @ by_hand(t, y, -1, p) + moves
    upper = slope @ by_hand(t, y, 1, p) + moves
    return float(lower), float(upper)


def slid(t: float, y: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return Filippov's field on the surface."""
    lower, upper = rates(t, y, p)
    share = lower / (lower - upper)
    return (1.0 - share) * by_hand(t, y, -1, p) + share * by_hand(t, y, 1, p)


def reference(y0: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, list[int]]:
    """Return the end state, and the modes that follow each other: -1, 0 or +1."""
    t, y = 0.0, np.array(y0)
    mode = 1 if height(t, y, p) > 0.0 else -1
    modes = [mode]
    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "max_step": 0.02}
    while True:
        if mode == 0:
            events = [lambda t, y: -rates(t, y, p)[0], lambda t, y: rates(t, y, p)[1]]
            for event in events:
                event.direction = 1.0
            run = lambda t, y: slid(t, y, p)  # noqa: E731 (short-lived)
        else:
            events = [lambda t, y: height(t, y, p)]
            events[0].direction = -float(mode)
            run = lambda t, y, lock=mode: by_hand(t, y, lock, p)  # noqa: E731
        for event in events:
            event.terminal = True
        found = reference_solve(run, (t, END), y, events=events, **options)
        t, y = found.t[-1], found.y[:, -1]
        if found.status == 0:
            return y, modes
        if mode == 0:
            mode = -1 if len(found.t_events[0]) else 1
        else:
            lower, upper = rates(t, y, p)
            mode = 0 if lower > 0.0 > upper else -mode
        modes.append(mode)


# The comparison.


def slope_of(end_of) -> np.ndarray:
    """Return the derivative of an end state by one number, by differences.

    Where two pairs disagree, the events of a neighbour differ: nearer ones are taken.
    """
    for step in (1e-4, 3e-6):
        ends = [end_of(shift * step) for shift in (2.0, 1.0, -1.0, -2.0)]
        inner = (ends[1] - ends[2]) / (2.0 * step)
        outer = (ends[0] - ends[3]) / (4.0 * step)
        if np.abs(inner - outer).max() < 1e-3 * max(1.0, np.abs(inner).max()):
            break
    return (4.0 * inner - outer) / 3.0


def flow_differences(y0, p, options, chosen):
    """Return the derivatives by the start, and by some parameters, by differences."""

    def end(start, params):
        found = solve(system, (0.0, END), start, params=params, t_eval=(), **options)
        return found.y_end

    by_start = [
        slope_of(lambda shift, j=j: end(y0 + shift * np.eye(N)[j], p)) for j in range(N)
    ]
    by_params = [
        slope_of(lambda shift, j=j: end(y0, p + shift * np.eye(N_PARAMS)[j]))
        for j in chosen
    ]
    return np.transpose(by_start), np.transpose(by_params)


CHOSEN = (0, 3, 9, 18, 21, 30, 31, 32, 33)  # parameters whose derivatives are compared
LAYER = 1e-3


def compare(seed: int, number: int, *, smoothed: bool) -> dict[str, float]:
    """Return the errors of a member."""
    y0, p = member(seed, number)
    options = {"rtol": 1e-10, "atol": 1e-12}
    found = solve(system, (0.0, END), y0, params=p, jacobian="params", **options)
    end, modes = reference(y0, p)
    first = modes[0]
    told = [first, *found.events.mode[:, 0]]
    tight = {"rtol": 1e-12, "atol": 1e-13}
    size = max(1.0, np.abs(end).max())
    row = {
        "status": float(found.status),
        "modes": float(told != modes),
        "slides": float(0 in modes),
        "events": float(len(modes) - 1),
        "proven": float(found.proven),
        "unproven": float(found.n_unproven),
        "close": float(found.n_close),
        "state": float(np.abs(found.y_end - end).max() / size),
        "differences": float(bool(found.by_differences)),
    }
    if found.jacobian is None or not found.success:
        return row
    by_start, by_params = flow_differences(y0, p, tight, CHOSEN)
    scale = max(1.0, np.abs(by_start).max())
    row["jacobian"] = float(np.abs(found.jacobian - by_start).max() / scale)
    scale = max(1.0, np.abs(by_params).max())
    chosen = found.sensitivity[:, list(CHOSEN)]
    row["params"] = float(np.abs(chosen - by_params).max() / scale)
    if smoothed:
        jacobians = []
        for layer in (LAYER, 0.5 * LAYER):
            given = np.append(p, layer)
            near = solve(
                smooth, (0.0, END), y0, params=given, jacobian=True, rtol=1e-9,
                atol=1e-11, t_eval=(),
            )  # fmt: skip
            jacobians.append(near.jacobian)
        scale = max(1.0, np.abs(found.jacobian).max())
        extrapolated = 2.0 * jacobians[1] - jacobians[0]
        off = np.abs(found.jacobian - extrapolated).max() / scale
        row["smoothed"] = float(off)
    return row


SUMS = ("status", "modes", "slides", "events", "proven", "unproven", "close")
ERRORS = ("state", "jacobian", "params", "smoothed")


def summary(rows: pd.DataFrame) -> dict[str, float]:
    """Return sums of what is counted, and median and worst of the errors."""
    told: dict[str, float] = {"members": len(rows)}
    for name in (*SUMS, "differences"):
        told[name] = rows[name].sum()
    for name in ERRORS:
        if name in rows:
            told[f"{name}_median"] = rows[name].median()
            told[f"{name}_worst"] = rows[name].max()
    return told


def main() -> None:
    """Write a table with a row for each seed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--members", type=int, default=8)
    parser.add_argument("--seeds", type=int, nargs="+", default=[11, 12, 13, 14, 15])
    parser.add_argument("--smoothed", action="store_true")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    table = []
    for seed in given.seeds:
        rows = []
        for number in range(given.members):
            rows.append(compare(seed, number, smoothed=given.smoothed))
        told = {"seed": seed, **summary(pd.DataFrame(rows))}
        print(" ".join(f"{name}={value:.3g}" for name, value in told.items()))
        table.append(told)
    pd.DataFrame(table).to_csv(given.out, index=False, float_format="%.3g")


if __name__ == "__main__":
    main()
