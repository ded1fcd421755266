"""The error of the flow's Jacobian through many contacts, beside its estimate.

    python benchmarks/derivative_error.py --out derivative_error.csv

A body of 2 kg on three pads falls from random starts and lands, through up to twelve
events. The pads are Hertz contacts (3e4 N/m^1.5), or springs as the control. The peers
are finite differences of `solve` at the same tolerance: forward and central, with the
steps at which rounding and truncation are balanced if the error of a solve is `rtol`.
There is one row for each kind of pads, start, `rtol` and time: the number of events;
the largest error of an entry, relative to the largest entry of its column, for the
Jacobian and for both differences; `jacobian_error`, and it over the error (`estimate`:
below 1, it is too small). The reference is the Jacobian at `rtol` 1e-13. `by_state` is
how much of the error comes from that of the state, which `jacobian_error` leaves out:
by the exact Jacobian from a start whose end is as wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hopdata.hybrid import System, solve

Floats = NDArray[np.float64]
REFERENCE = 1e-13
RTOLS = (1e-6, 1e-8, 1e-10)
TIMES_S = (0.35, 0.9)
PADS = ((0.12, 0.0), (-0.06, 0.1), (-0.06, -0.1))  # m, from above


def falls(_t: float, y: Floats, mode: Any, p: Floats) -> Any:
    """Return the rates of height, pitch, roll and their velocities."""
    up, pitch, roll = -9.81, 0.0, 0.0
    for pad in range(3):
        if mode[pad] > 0:  # this pad is down
            x, side = PADS[pad]
            depth = x * y[1] - side * y[2] - y[0]
            if p[1] > 1.0:
                push = p[0] * max(depth, 0.0) ** p[1]
            else:
                push = p[0] * depth
            up += push / 2.0
            pitch -= x * push / 0.02
            roll += side * push / 0.02
    return y[3], y[4], y[5], up, pitch, roll


def depths(_t: float, y: Floats) -> Any:
    """Return how deep each pad is below the floor, m."""
    return (
        PADS[0][0] * y[1] - PADS[0][1] * y[2] - y[0],
        PADS[1][0] * y[1] - PADS[1][1] * y[2] - y[0],
        PADS[2][0] * y[1] - PADS[2][1] * y[2] - y[0],
    )


BODY = System(falls, depths, n_states=6, guard_names=("pad1", "pad2", "pad3"))
# Stiffness and exponent of each kind of pads.
PADS_OF = {"hertz": (3e4, 1.5), "springs": (3e3, 1.0)}


def ends(start: Floats, until_s: float, rtol: float, pads: Any, **options: Any) -> Any:
    """Integrate from a start."""
    tolerances = {"rtol": rtol, "atol": 1e-3 * rtol}
    end = solve(BODY, (0.0, until_s), start, params=pads, **tolerances, **options)
    if end.status != 0:
        raise RuntimeError(end.message)
    return end


def differences(start: Floats, until_s: float, rtol: float, pads: Any) -> Any:
    """Return forward and central differences of the end state."""
    forward = []
    central = []
    here = ends(start, until_s, rtol, pads).y_end
    for axis in np.eye(len(start)):
        step = rtol ** (1 / 2)
        ahead = ends(start + step * axis, until_s, rtol, pads).y_end
        forward.append((ahead - here) / step)
        step = rtol ** (1 / 3)
        ahead = ends(start + step * axis, until_s, rtol, pads).y_end
        behind = ends(start - step * axis, until_s, rtol, pads).y_end
        central.append((ahead - behind) / (2 * step))
    return np.array(forward).T, np.array(central).T


def error(found: Floats, exact: Floats) -> float:
    """Return the largest error of an entry, in the largest of its column."""
    return float((np.abs(found - exact).max(0) / np.abs(exact).max(0)).max())


def rows(starts: int, seed: int, pads: Any) -> Iterator[dict[str, float]]:
    """Yield a row for each start, tolerance and time."""
    rng = np.random.default_rng(seed)
    for number in range(starts):
        start = np.array([0.25, 0.0, 0.0, 0.0, 0.0, 0.0])
        start += 0.02 * rng.standard_normal(6)
        for until_s in TIMES_S:
            reference = ends(start, until_s, REFERENCE, pads, jacobian=True)
            exact = reference.jacobian
            for rtol in RTOLS:
                found = ends(start, until_s, rtol, pads, jacobian=True)
                forward, central = differences(start, until_s, rtol, pads)
                wrong = error(found.jacobian, exact)
                # A start whose exact end is as wrong as this one's end.
                moved = start + np.linalg.solve(exact, found.y_end - reference.y_end)
                beside = ends(moved, until_s, REFERENCE, pads, jacobian=True)
                yield {
                    "start": number,
                    "until_s": until_s,
                    "rtol": rtol,
                    "events": found.n_events,
                    "error": wrong,
                    "error_rtol": wrong / rtol,
                    "jacobian_error": found.jacobian_error,
                    "estimate": found.jacobian_error / wrong,
                    "by_state": error(beside.jacobian, exact) / wrong,
                    "forward": error(forward, exact),
                    "central": error(central, exact),
                    "nfev": found.nfev,
                }


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--starts", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    parts = []
    for kind, pads in PADS_OF.items():
        found = pd.DataFrame(rows(options.starts, options.seed, pads))
        parts.append(found.assign(pads=kind))
    table = pd.concat(parts)
    table.to_csv(options.out, index=False, float_format="%.4g")
    columns = ["events", "error_rtol", "estimate", "by_state", "forward", "central"]
    by = table.groupby(["pads", "until_s", "rtol"])[columns]
    print(by.median().to_string(float_format="%.3g"))
    print(by.agg({"error_rtol": "max", "estimate": ["min", "max"]}))


if __name__ == "__main__":
    main()
