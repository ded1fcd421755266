"""Contact instants and orders: the printed method, a loop of scipy fits, and our kink fit.

    python benchmarks/labelling.py --out labelling.csv

Three feet fall freely at 1 m/s onto a hard floor and are seen at 100 Hz with 0.6 mm of noise, their
contacts either exactly 5 ms apart or drawn from N(0, 10 ms). One row for each method and spacing:
`sd_ms` of the instants about their common bias beside the Cramer-Rao bound, the share of errors
within the stated standard error, the share of landings whose order is right, and the time for one
foot in one landing. `ratio` is the time of the scipy loop, run on the first landings only, over
that of the method, one after the other in this process. "One fit" is what scipy does, a single fit
of each foot from a start near the truth; the other kink rows are the whole of `find_contacts`: the
search for the start and seven fits, in which the pushes of earlier feet are learned (there are none
here, which costs a little: the bound knows that).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import curve_fit

from hopdata.landings.contacts import find_contacts
from hopdata.landings.kink import FlightPriors, kink_fits
from hopdata.landings.transitions import Transitions

FloatArray = NDArray[np.float64]

RATE_HZ, NOISE_M, SPEED_M_S, GRAVITY_M_S2 = 100.0, 6e-4, 1.0, 9.80665
BEFORE_S, AFTER_S, PERIOD_S = 0.08, 0.05, 0.5


@dataclass(frozen=True)
class Landings:
    """Frames (N,), heights (N, 3), true contacts (L, 3) and the transitions about them."""

    time: FloatArray
    heights: FloatArray
    contacts: FloatArray
    transitions: Transitions

    def first(self, count: int) -> Landings:
        """Return the first `count` landings."""
        t = self.transitions
        kept = Transitions(*(x[:count] for x in (t.t_pre, t.t_post, t.gap_pre, t.gap_post)))
        return Landings(self.time, self.heights, self.contacts[:count], kept)


def fall(s: FloatArray) -> FloatArray:
    """Return the height of a foot `s` seconds after its contact."""
    return np.where(s < 0, -SPEED_M_S * s - 0.5 * GRAVITY_M_S2 * s**2, 0.0)


def make(count: int, spacing: str, rng: np.random.Generator) -> Landings:
    """Simulate landings with contacts 5 ms apart in random order, or from N(0, 10 ms)."""
    frames = int(PERIOD_S * RATE_HZ)
    seconds = np.arange(count * frames) / RATE_HZ
    if spacing == "5 ms":
        offsets = rng.permuted(np.tile([-0.005, 0.0, 0.005], (count, 1)), axis=1)
    else:
        offsets = rng.normal(0, 0.01, (count, 3))
    middle = 0.3 + PERIOD_S * np.arange(count) + rng.uniform(0, 1 / RATE_HZ, count)
    contacts = middle[:, None] + offsets
    s = seconds.reshape(count, frames, 1) - contacts[:, None, :]
    heights = fall(s).reshape(-1, 3) + rng.normal(0, NOISE_M, (count * frames, 3))
    gap = np.full(count, 1 / RATE_HZ)
    ends = contacts.min(axis=1) - 0.05, contacts.max(axis=1) + 0.02
    return Landings(seconds, heights, contacts, Transitions(*ends, gap, gap))


def bound_s(known: bool) -> float:
    """Return the Cramer-Rao bound of an instant in our window, mean over the phase of frames."""
    variances = []
    for phase in np.linspace(0, 1 / RATE_HZ, 41)[:-1]:
        s = np.arange(-round(BEFORE_S * RATE_HZ), round(AFTER_S * RATE_HZ)) / RATE_HZ + phase
        flight = np.where(s < 0, 1.0, 0.0)
        columns = [flight * (SPEED_M_S + GRAVITY_M_S2 * s), np.ones_like(s), flight * s]
        jacobian = np.column_stack(columns if known else [*columns, flight * s**2])
        variances.append(np.linalg.inv(jacobian.T @ jacobian)[0, 0])
    return NOISE_M * float(np.sqrt(np.mean(variances)))


def ours(landings: Landings, **options: Any) -> tuple[FloatArray, FloatArray]:
    """Return instants and standard errors by `find_contacts`."""
    found = find_contacts(
        landings.time, landings.heights, landings.transitions, down_height_m=0.01, **options
    )
    return found.instant, found.se


def one_fit(landings: Landings, *, known: bool) -> tuple[FloatArray, FloatArray]:
    """Return instants and standard errors by a single kink fit of each foot, as scipy does it."""
    sharp = (-GRAVITY_M_S2, 1e-3) if known else (0.0, 1e4)
    priors = FlightPriors(*(np.tile([own, 0, 0, 0, 0, 0], (3, 1)) for own in sharp))
    priors.sd[:, 1:] = 1e4
    fits = kink_fits(
        landings.time,
        landings.heights,
        landings.contacts + 0.002,
        priors=priors,
        noise_m=NOISE_M,
        windows_s=(BEFORE_S, AFTER_S),
        search_s=0.015,
    )
    return fits.instant, NOISE_M * fits.unit_se


def scipy_loop(landings: Landings) -> tuple[FloatArray, FloatArray]:
    """Return instants and standard errors by one `curve_fit` for each foot of each landing."""

    def model(s: FloatArray, tau: float, c: float, b: float, a: float) -> FloatArray:
        u = np.minimum(s - tau, 0.0)
        return c + b * u + 0.5 * a * u**2

    instant, se = np.full_like(landings.contacts, np.nan), np.full_like(landings.contacts, np.nan)
    for row, foot in np.ndindex(landings.contacts.shape):
        near = landings.contacts[row, foot] + 0.002
        start, stop = np.searchsorted(landings.time, [near - BEFORE_S, near + AFTER_S])
        s, z = landings.time[start:stop] - near, landings.heights[start:stop, foot]
        try:
            best, covariance = curve_fit(model, s, z, p0=(0.0, 0.0, -1.0, -9.0))
        except RuntimeError:
            continue
        instant[row, foot] = near + best[0]
        se[row, foot] = NOISE_M * np.sqrt(covariance[0, 0] / np.mean((z - model(s, *best)) ** 2))
    return instant, se


METHODS: dict[str, tuple[Callable[[Landings], tuple[FloatArray, FloatArray]], bool | None]] = {
    "velocity minimum, whole frame": (partial(ours, method="velocity_minimum"), None),
    "velocity minimum, parabola": (partial(ours, method="velocity_minimum_parabola"), None),
    "scipy curve_fit loop, free": (scipy_loop, False),
    "kink, one fit, free": (partial(one_fit, known=False), False),
    "kink, one fit, known": (partial(one_fit, known=True), True),
    "kink, free": (partial(ours, gravity="free"), False),
    "kink, learned": (partial(ours, gravity="learned"), True),
    "kink, known": (partial(ours, gravity="known"), True),
}


def measure(name: str, landings: Landings, spacing: str) -> dict[str, float | str]:
    """Measure one method on one set of landings."""
    method, known = METHODS[name]
    begin = time.perf_counter()
    instant, se = method(landings)
    seconds = time.perf_counter() - begin
    whole = np.isfinite(instant).all(axis=1)
    error = (instant - landings.contacts)[whole]
    order, truth = (np.argsort(x[whole], axis=1) for x in (instant, landings.contacts))
    return {
        "method": name,
        "spacing": spacing,
        "landings": len(landings.contacts),
        "found": float(whole.mean()),
        "bias_ms": 1e3 * float(error.mean()),
        "sd_ms": 1e3 * float(error.std()),
        "bound_ms": float("nan") if known is None else 1e3 * bound_s(known),
        "within_se": float(np.mean(np.abs(error - error.mean()) < se[whole])),
        "order_right": float((order == truth).all(axis=1).mean()),
        "us_per_fit": 1e6 * seconds / landings.contacts.size,
        "seconds": seconds,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--landings", type=int, default=2860, help="landings (default 2860)")
    parser.add_argument("--peer-landings", type=int, default=300, help="for scipy (default 300)")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    rows = []
    for spacing in ("5 ms", "N(0, 10 ms)"):
        landings = make(arguments.landings, spacing, rng)
        ours(landings.first(5))  # compile before the clock runs
        for name in METHODS:
            few = METHODS[name][0] is scipy_loop
            subset = landings.first(arguments.peer_landings) if few else landings
            rows.append(measure(name, subset, spacing))
    table = pd.DataFrame(rows)
    loop = table[table["method"].str.startswith("scipy")].set_index("spacing")["us_per_fit"]
    table["ratio"] = table["spacing"].map(loop) / table["us_per_fit"]
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(arguments.out, index=False, float_format="%.6g")
    print(table.round(3).to_string(index=False))


if __name__ == "__main__":
    main()
