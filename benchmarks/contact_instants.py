"""Contact instants and orders: the printed method, loops of SciPy fits, and our kink fit.

    python benchmarks/contact_instants.py --out contact_instants.csv [--seeds 5]
    [--landings 2860]

Three feet fall freely at 1 m/s onto a floor and are seen at 100 Hz with 0.6 mm of
noise, at any phase between frames. There is one row for each condition and method, over
several seeds, with Monte-Carlo standard errors (`_se`). `sd_ms` is the standard
deviation of the instants about their common bias, given beside the Cramer-Rao bound for
the frames of the fit. `covered` is the share of instants within one standard error
after removing that bias (ideally 0.683). The share of landings with the right order is
given for all timed landings, and for those whose order is not ambiguous (its
probability reaches `touchdowns.ambiguous_below`). `seconds` and `us_per_fit` are CPU
time, of all landings of a seed and of one foot in one landing. `times_faster` is the
time of the curve_fit loop, run on the first landings only, over that of the method; the
two take turns in this process. "One fit" does what scipy does: a single fit of each
foot from a start near the truth. The other kink rows run the whole of `find_contacts`.

The last rows are of a runner at 2.5 m/s (see the README for the files). The first
contact of each foot's three markers is compared with the force plate, with `sd_ms` from
the median absolute deviation. For three runs, the landings are counted, and the share
`found` that gives a pair of states.

Then come short simulated recordings of three animals, whose feet stop at once or within
2 or 5 ms. `own_over_se` is the rms of the errors about their mean in the recording,
over the stated errors; `bias_ms` is the rms of these means, `common_ms` the error
stated for it, and `bias_over_common` their ratio.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline
from scipy.optimize import curve_fit, least_squares

from hopdata.arrays import GRAVITY_M_S2, FloatArray
from hopdata.landings.contacts.descents import LANDED, Transitions
from hopdata.landings.contacts.find import find_landings
from hopdata.landings.contacts.kink import FlightPriors, kink_fits
from hopdata.landings.contacts.passes import LONG_WINDOWS_S
from hopdata.landings.contacts.tables import contacts_of
from hopdata.landings.contacts.timing import find_contacts
from hopdata.landings.floor import fit_floor, level
from hopdata.landings.forces import force_onsets
from hopdata.landings.schedules import order_probability
from hopdata.landings.sections.select import select_sections
from hopdata.landings.states.assemble import assemble_pairs
from hopdata.landings.touchdowns import NO_FOOT_LANDED, touchdown_table
from hopdata.recording import Recording
from hopdata.recordings.importing import import_recording
from hopdata.synthesis.simulate import simulate_recording
from hopdata.truth import Truth

# The least possible uncertainty of a contact instant: the Cramer-Rao bound of the kink.
#
# No unbiased estimate from the same frames has a smaller standard deviation than this
# bound, which is the square root of the instant's entry in the inverse of the Fisher
# information for the instant and all other unknowns.

PHASES = 100


def kink_bound(
    s: FloatArray,
    *,
    noise_m: float,
    velocity_m_s: float,
    known_gravity: bool,
    compliance_s: float = 0.0,
    creep_m_s: float = 0.0,
) -> float:
    """Return the least standard deviation of a contact instant, from frames `s` seconds after it.

    Floor and velocity are also unknown, and so is the acceleration in flight unless it
    is gravity; compliance and creep are known.

    Parameters
    ----------
    s : (N,) array
        Times of the frames since the contact, s; negative in flight.
    noise_m : float
        Standard deviation of a height, m.
    velocity_m_s : float
        Vertical velocity just before the contact, m/s, negative.
    known_gravity : bool
        Whether the acceleration is known.
    compliance_s, creep_m_s : float
        See `hopdata.landings.contacts.kink`.

    Returns
    -------
    float
        The bound, s; infinite if the frames do not determine the instant.
    """
    flight = s < 0
    decay = np.zeros_like(s)
    if compliance_s > 0:
        decay = np.exp(-np.maximum(s, 0.0) / compliance_s)
    by_instant = np.where(
        flight, GRAVITY_M_S2 * s - velocity_m_s, -velocity_m_s * decay - creep_m_s
    )
    by_velocity = np.where(flight, s, compliance_s * (1 - decay))
    columns = [by_instant, np.ones_like(s), by_velocity]
    if not known_gravity:
        columns.append(np.where(flight, s**2 / 2, 0.0))
    jacobian = np.column_stack(columns)
    scale = np.linalg.norm(jacobian, axis=0)
    jacobian = jacobian / np.where(scale > 0, scale, 1.0)
    information = jacobian.T @ jacobian
    if np.linalg.matrix_rank(information, tol=1e-9) < len(columns):
        return float("inf")
    return noise_m * float(np.sqrt(np.linalg.inv(information)[0, 0]) / scale[0])


def mean_kink_bound(
    *,
    rate_hz: float,
    windows_s: tuple[float, float],
    noise_m: float,
    velocity_m_s: float,
    known_gravity: bool,
    missing_frames: int = 0,
    compliance_s: float = 0.0,
    creep_m_s: float = 0.0,
) -> float:
    """Return the root mean square of the bound over all phases between contact and frames, s.

    Parameters
    ----------
    rate_hz : float
        Frame rate, Hz.
    windows_s : tuple of float
        Durations before and after the contact from which frames are used, s.
    missing_frames : int
        Odd number of unseen frames about the contact, or 0.
    noise_m, velocity_m_s, known_gravity, compliance_s, creep_m_s
        See `kink_bound`.
    """
    before, after = (round(window * rate_hz) for window in windows_s)
    bounds = []
    for phase in (np.arange(PHASES) + 0.5) / PHASES:
        frames = np.arange(-before, after) + phase
        seen = (
            np.abs(np.arange(-before, after) + round(phase)) > (missing_frames - 1) / 2
        )
        seen |= missing_frames == 0
        bounds.append(
            kink_bound(
                frames[seen] / rate_hz,
                noise_m=noise_m,
                velocity_m_s=velocity_m_s,
                known_gravity=known_gravity,
                compliance_s=compliance_s,
                creep_m_s=creep_m_s,
            )
        )
    return float(np.sqrt(np.mean(np.square(bounds))))


Found = tuple[FloatArray, FloatArray]  # instants and standard errors, s

RATE_HZ, NOISE_M, SPEED_M_S = 100.0, 6e-4, 1.0
PERIOD_S, NEAR_S, SPREAD_S = 0.5, 0.002, 0.01
BEFORE_S, AFTER_S = LONG_WINDOWS_S
AMBIGUOUS_BELOW = 0.9  # default of touchdowns.ambiguous_below


@dataclass(frozen=True)
class Condition:
    """How feet land: whether contacts are 5 ms apart, missing frames, soft or creeping contacts."""

    apart: bool = False
    missing_frames: int = 0
    compliance_s: float = 0.0
    creep_m_s: float = 0.0

    def height(self, s: FloatArray) -> FloatArray:
        """Return the height of a foot `s` seconds after its contact, m."""
        fall = -SPEED_M_S * s - 0.5 * GRAVITY_M_S2 * s**2
        after = np.maximum(s, 0.0)
        sunk = self.creep_m_s * after
        if self.compliance_s:
            sunk -= (
                SPEED_M_S * self.compliance_s * (1 - np.exp(-after / self.compliance_s))
            )
        return np.where(s < 0, fall, sunk)

    def bound_s(self, *, known: bool) -> float:
        """Return the Cramer-Rao bound of an instant in our window, s."""
        return mean_kink_bound(
            rate_hz=RATE_HZ,
            windows_s=LONG_WINDOWS_S,
            noise_m=NOISE_M,
            velocity_m_s=-SPEED_M_S,
            known_gravity=known,
            missing_frames=self.missing_frames,
            compliance_s=self.compliance_s,
            creep_m_s=self.creep_m_s,
        )


CONDITIONS = {
    "hard, 5 ms apart": Condition(apart=True),
    "hard, N(0, 10 ms)": Condition(),
    "three frames missing at each contact": Condition(missing_frames=3),
    "soft, 5 ms": Condition(compliance_s=0.005),
    "creep of 20 mm/s": Condition(creep_m_s=-0.02),
    "soft and creep": Condition(compliance_s=0.005, creep_m_s=-0.02),
}


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
        kept = Transitions(
            *(x[:count] for x in (t.t_pre, t.t_post, t.gap_pre, t.gap_post))
        )
        return Landings(self.time, self.heights, self.contacts[:count], kept)

    def filled(self) -> Landings:
        """Fill missing frames by a cubic spline, as motion-capture software does."""
        heights = self.heights.copy()
        for z in heights.T:
            seen = np.isfinite(z)
            z[~seen] = CubicSpline(self.time[seen], z[seen])(self.time[~seen])
        return replace(self, heights=heights)


def make(count: int, condition: Condition, rng: np.random.Generator) -> Landings:
    """Simulate landings with contacts 5 ms apart in random order, or from N(0, 10 ms)."""
    frames = int(PERIOD_S * RATE_HZ)
    seconds = np.arange(count * frames) / RATE_HZ
    offsets = rng.normal(0, SPREAD_S, (count, 3))
    if condition.apart:
        offsets = rng.permuted(np.tile([-0.005, 0.0, 0.005], (count, 1)), axis=1)
    middle = 0.3 + PERIOD_S * np.arange(count) + rng.uniform(0, 1 / RATE_HZ, count)
    contacts = middle[:, None] + offsets
    s = seconds.reshape(count, frames, 1) - contacts[:, None, :]
    heights = condition.height(s) + rng.normal(0, NOISE_M, s.shape)
    if condition.missing_frames:
        nearest = np.abs(s).argmin(axis=1)[:, None]
        distance = np.abs(np.arange(frames)[:, None] - nearest)
        heights[distance <= condition.missing_frames // 2] = np.nan
    gap = np.full(count, 1 / RATE_HZ)
    ends = contacts.min(axis=1) - 0.05, contacts.max(axis=1) + 0.02
    return Landings(
        seconds, heights.reshape(-1, 3), contacts, Transitions(*ends, gap, gap)
    )


def ours(landings: Landings, **options: Any) -> Found:
    """Return instants and standard errors by `find_contacts`; NaN for fits that it rejects."""
    found = find_contacts(
        landings.time,
        landings.heights,
        landings.transitions,
        down_height_m=0.015,
        **options,
    )
    return np.where(found.status == LANDED, found.instant, np.nan), found.se


def filled(landings: Landings, **options: Any) -> Found:
    """Return the results of `find_contacts` after filling gaps."""
    return ours(landings.filled(), **options)


def one_fit(landings: Landings, *, known: bool) -> Found:
    """Return instants and standard errors by a single kink fit of each foot, as scipy does it."""
    own = (-GRAVITY_M_S2, 1e-3) if known else (0.0, 1e4)
    mean, sd = ([own[0], 0, 0, 0, 0, 0], [own[1], 1e4, 1e4, 1e4, 1e4, 1e4])
    fits = kink_fits(
        landings.time,
        landings.heights,
        landings.contacts + NEAR_S,
        priors=FlightPriors(np.tile(mean, (3, 1)).astype(float), np.tile(sd, (3, 1))),
        noise_m=NOISE_M,
        windows_s=LONG_WINDOWS_S,
        search_s=0.015,
    )
    return fits.instant, NOISE_M * fits.unit_se


def model(s: FloatArray, tau: float, c: float, b: float, a: float) -> FloatArray:
    """Return the height of a foot with a hard contact at `tau`."""
    u = np.minimum(s - tau, 0.0)
    return c + b * u + 0.5 * a * u**2


def by_curve_fit(s: FloatArray, z: FloatArray) -> tuple[float, float]:
    """Return the instant of one foot and its standard error, by `curve_fit`."""
    best, covariance = curve_fit(model, s, z, p0=(0.0, 0.0, -1.0, -9.0))
    return best[0], np.sqrt(covariance[0, 0] / np.mean((z - model(s, *best)) ** 2))


def by_least_squares(s: FloatArray, z: FloatArray) -> tuple[float, float]:
    """Return the same by `least_squares`."""
    fit = least_squares(lambda p: z - model(s, *p), (0.0, 0.0, -1.0, -9.0))
    return fit.x[0], np.sqrt(np.linalg.pinv(fit.jac.T @ fit.jac)[0, 0])


def scipy_loop(
    landings: Landings, *, fit: Callable[[FloatArray, FloatArray], tuple[float, float]]
) -> Found:
    """Return instants and standard errors by one scipy fit for each foot of each landing."""
    instant, se = (
        np.full_like(landings.contacts, np.nan),
        np.full_like(landings.contacts, np.nan),
    )
    for row, foot in np.ndindex(landings.contacts.shape):
        near = landings.contacts[row, foot] + NEAR_S
        start, stop = np.searchsorted(landings.time, [near - BEFORE_S, near + AFTER_S])
        s, z = landings.time[start:stop] - near, landings.heights[start:stop, foot]
        seen = np.isfinite(z)
        try:
            found = fit(s[seen], z[seen])
        except (RuntimeError, TypeError):  # no convergence, too few frames
            continue
        instant[row, foot], se[row, foot] = near + found[0], NOISE_M * found[1]
    return instant, se


@dataclass(frozen=True)
class Method:
    """A way to find instants, and whether it knows gravity (None: no bound applies)."""

    find: Callable[[Landings], Found]
    known: bool | None = None
    only_hard: bool = False
    slow: bool = False


METHODS = {
    "velocity minimum, whole frame": Method(partial(ours, method="velocity_minimum")),
    "velocity minimum, parabola": Method(
        partial(ours, method="velocity_minimum_parabola")
    ),
    "velocity minimum, parabola, gaps filled": Method(
        partial(filled, method="velocity_minimum_parabola")
    ),
    "scipy curve_fit loop, free": Method(
        partial(scipy_loop, fit=by_curve_fit), False, slow=True
    ),
    "scipy least_squares loop, free": Method(
        partial(scipy_loop, fit=by_least_squares), False, True, True
    ),
    "kink, one fit, free": Method(partial(one_fit, known=False), False, True),
    "kink, one fit, known": Method(partial(one_fit, known=True), True, True),
    "kink, free": Method(partial(ours, gravity="free"), False),
    "kink, learned": Method(partial(ours, gravity="learned"), True),
    "kink, known": Method(partial(ours, gravity="known"), True),
}


def asked(condition: Condition, name: str) -> bool:
    """Return whether a method is tried in a condition."""
    hard = condition in (
        CONDITIONS["hard, 5 ms apart"],
        CONDITIONS["hard, N(0, 10 ms)"],
    )
    if "filled" in name:
        return condition.missing_frames > 0
    return hard or not METHODS[name].only_hard


def measure(method: Method, landings: Landings) -> dict[str, float]:
    """Measure one method on the landings of one seed."""
    begin = time.process_time()
    instant, se = method.find(landings)
    seconds = time.process_time() - begin
    whole = np.isfinite(instant).all(axis=1)
    result = {"found": float(whole.mean()), "seconds": seconds}
    if not whole.any():
        return result
    error = (instant - landings.contacts)[whole]
    order, truth = (np.argsort(x[whole], axis=1) for x in (instant, landings.contacts))
    right = (order == truth).all(axis=1)
    sure = order_probability(instant[whole], se[whole]) >= AMBIGUOUS_BELOW
    return result | {
        "bias_ms": 1e3 * float(error.mean()),
        "sd_ms": 1e3 * float(error.std()),
        "covered": float(np.mean(np.abs(error - error.mean()) < se[whole])),
        "order_right": float(right.mean()),
        "unambiguous": float(sure.mean()),
        "right_of_unambiguous": float(right[sure].mean())
        if sure.any()
        else float("nan"),
    }


def summary(runs: list[dict[str, float]], feet: int) -> dict[str, float]:
    """Return means over the seeds with standard errors, and the least time of one run."""
    table = pd.DataFrame(runs)
    seconds = table.pop("seconds").min()
    row: dict[str, float] = {}
    for name in table:
        row[str(name)] = float(table[name].mean())
        if name not in ("found", "bias_ms", "unambiguous"):
            row[f"{name}_se"] = float(table[name].std() / np.sqrt(len(table)))
    return row | {"seconds": seconds, "us_per_fit": 1e6 * seconds / feet}


def rows_of(name: str, arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Measure every method in one condition, seed by seed in turn."""
    condition = CONDITIONS[name]
    runs: dict[str, list[dict[str, float]]] = {
        key: [] for key in METHODS if asked(condition, key)
    }
    seeds = np.random.SeedSequence([arguments.seed, list(CONDITIONS).index(name)])
    for seed in seeds.spawn(arguments.seeds):
        landings = make(arguments.landings, condition, np.random.default_rng(seed))
        few = landings.first(arguments.peer_landings)
        for key, results in runs.items():
            results.append(
                measure(METHODS[key], few if METHODS[key].slow else landings)
            )
    rows = []
    for key, results in runs.items():
        method = METHODS[key]
        count = arguments.peer_landings if method.slow else arguments.landings
        row = {
            "condition": name,
            "method": key,
            "seeds": arguments.seeds,
            "landings": count,
        }
        found = summary(results, 3 * count)
        if method.known is not None:
            bound_ms = 1e3 * condition.bound_s(known=method.known)
            ratio = found.get("sd_ms", float("nan")) / bound_ms
            found |= {"bound_ms": bound_ms, "sd_over_bound": ratio}
        rows.append(row | found)
    return rows


# Ratios of errors to stated errors in short recordings: three animals, two rates, hard
# and soft contacts.

ANIMALS: dict[str, dict[str, Any]] = {
    "hopper": {},
    "biped": {
        "hopper": {
            "n_legs": 2,
            "stiffness_n_m": 135.0,
            "damping_n_s_m": 7.2,
            "preload_n": 33.0,
        },
        "operator": {"arena_m": 1e-6, "carry_s": 0.5},
    },
    "quadruped": {"scene": "quadruped"},
}
SEEN = {"rate_hz": 1000, "noise_m": 0.0, "resolution_m": 0.0}
FLAT = {"bowl_depth_m": 0.0, "waves": 0}
FEW, MOST_PIECES, FEW_HOPS = (2, 5, 10, 20, 40, 400), 8, 410
SOFT_S, FEW_RATES_HZ = (0.0, 0.002, 0.005), (100, 250)


def softened(seen: Recording, truth: Truth, time_s: float) -> Recording:
    """Let feet sink in at contact: they lose their velocity within `time_s` and return in 0.2 s."""
    positions, time = seen.positions.copy(), seen.time
    for landing, foot in (
        np.argwhere(np.isfinite(truth.contact_times)) if time_s else ()
    ):
        touch, marker = truth.contact_times[landing, foot], seen.indices("foot")[foot]
        first, last = np.searchsorted(time, [touch, touch + 0.3])
        if first >= 3:
            z, step = seen.positions[first - 3 : first, marker, 2], time[1] - time[0]
            bend = (z[2] - 2 * z[1] + z[0]) / step**2
            speed = (z[2] - z[1]) / step + bend * (touch - time[first - 1] + step / 2)
            s = time[first:last] - touch
            sunk = (
                speed
                * time_s
                * (1 - np.exp(-s / time_s))
                * np.clip((0.2 - s) / 0.1, 0, 1)
            )
            positions[first:last, marker, 2] += sunk
    return replace(seen, positions=positions)


def pieces(
    seen: Recording, truth: Truth, count: int
) -> Iterator[tuple[Recording, FloatArray]]:
    """Yield consecutive recordings of `count` landings each, with their true contacts."""
    whole = np.flatnonzero(np.isfinite(truth.contact_times).all(axis=1))
    runs = [whole[k : k + count] for k in range(0, len(whole) - count + 1, count)]
    for rows in [run for run in runs if run[-1] - run[0] == count - 1][:MOST_PIECES]:
        contacts = truth.contact_times[rows]
        span = truth.apex_times[rows[0]] - 0.02, contacts[-1].max() + 0.15
        yield seen.part(slice(*np.searchsorted(seen.time, span))), contacts


def piece_errors(
    piece: Recording, true: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Return errors and standard errors of the landings found, and the common error, all in s."""
    found = contacts_of(find_landings(piece))
    near = (np.abs(found.instant[:, None] - true) < SAME_S).all(axis=2)
    row, landing = np.nonzero(near & (found.status == LANDED).all(axis=1)[:, None])
    common = float(np.sqrt(np.mean(found.common**2))) if len(row) else float("nan")
    return found.instant[row] - true[landing], found.se[row], common


def few_rows(seeds: range) -> list[dict[str, Any]]:
    """Return one row for each animal, rate, softness and number of landings."""
    rows: dict[Any, list[Any]] = {}
    for animal, seed in product(ANIMALS, seeds):
        simulation = {**ANIMALS[animal], "hops": FEW_HOPS}
        seen, truth = simulate_recording(
            simulation, {**SEEN, "floor": FLAT}, seed=[seed, 26]
        )
        for soft_s, rate in product(SOFT_S, FEW_RATES_HZ):
            step, rng = (
                1000 // rate,
                np.random.default_rng([seed, rate, int(1e4 * soft_s)]),
            )
            one = softened(seen, truth, soft_s).part(slice(seed % step, None, step))
            noisy = one.positions + rng.normal(0, NOISE_M, one.positions.shape)
            one = replace(one, positions=noisy, rate_hz=float(rate))
            for count in FEW:
                name = f"{animal}, {rate} Hz, soft {1e3 * soft_s:g} ms"
                found = [
                    piece_errors(piece, true)
                    for piece, true in pieces(one, truth, count)
                ]
                rows.setdefault((name, count), []).extend(found)
    return [few_row(name, count, found) for (name, count), found in rows.items()]


def few_row(name: str, count: int, found: list[Any]) -> dict[str, Any]:
    """Return ratios of rms errors to stated errors: about the recording's mean, and of the mean."""
    errors, se, common = zip(*found, strict=True)
    own, means = [], []
    for error, stated, shared in zip(errors, se, common, strict=True):
        if len(error):
            mean, n = float(error.mean()), error.size
            own.append((error - mean) / stated * np.sqrt(n / (n - 1)))
            means.append(
                (mean, np.hypot(shared, np.sqrt((stated**2).mean() / n)), shared)
            )
    mean, stated, shared = np.array(means).T
    each = np.concatenate([one.ravel() for one in own])
    return {
        "condition": name,
        "method": "kink, learned",
        "landings": count,
        "found": sum(len(error) for error in errors) / (count * len(found)),
        "bias_ms": 1e3 * float(np.sqrt(np.mean(mean**2))),
        "common_ms": 1e3 * float(np.sqrt(np.mean(shared**2))),
        "own_over_se": float(np.sqrt(np.mean(each**2))),
        "bias_over_common": float(np.sqrt(np.mean((mean / stated) ** 2))),
    }


COLUMNS = (
    *(
        "condition",
        "method",
        "seeds",
        "landings",
        "found",
        "bias_ms",
        "sd_ms",
        "sd_ms_se",
    ),
    *(
        "bound_ms",
        "sd_over_bound",
        "covered",
        "covered_se",
        "order_right",
        "order_right_se",
    ),
    *(
        "unambiguous",
        "right_of_unambiguous",
        "right_of_unambiguous_se",
        "seconds",
        "us_per_fit",
    ),
    *("times_faster", "missed", "invented"),
    *("common_ms", "own_over_se", "bias_over_common"),
)


# First contacts of a runner's feet compared with the onset of force, for each method.


ROOT = Path(__file__).parents[1]
FOLDERS = (
    ROOT / "data/sample",
    ROOT / "data/external",
    ROOT.parent / "shared/recordings/treadmill_running",
)
MARKERS, FORCES = "RBDS001runT25markers.tsv", "RBDS001runT25forces.txt"
HEADER_LINES, RUNNER_HZ, FORCE_HZ = 11, 150.0, 300.0
AT_REST_M = (0.034, 0.045, 0.050)  # standing foot: heel, first and fifth metatarsal
SECTIONS = {
    "pre_height_m": 1.07,
    "post_height_m": 1.02,
}  # every descent of the body passes both
SAME_S = 0.05  # a contact and an onset farther apart belong to different landings, s
RUNNER_METHODS = {
    "velocity minimum, whole frame": "velocity_minimum",
    "velocity minimum, parabola": "velocity_minimum_parabola",
    "kink, learned": "kink",
}
SIDES = {"L": (0, "left"), "R": (1, "right")}  # the first onset is of the left foot


def runner_rows() -> list[dict[str, Any]]:
    """Return one row for each foot and method, or one that says the files are absent."""
    folder = next(
        (f for f in FOLDERS if (f / MARKERS).is_file() and (f / FORCES).is_file()), None
    )
    if folder is None:
        return [
            {
                "condition": "runner against force",
                "method": "absent: no files of the runner",
            }
        ]
    force = pd.read_csv(folder / FORCES, sep="\t")["Fy"].to_numpy(
        float
    )  # upwards in this file
    onsets = force_onsets(np.arange(len(force)) / FORCE_HZ, force)
    rows = []
    for side, (turn, name) in SIDES.items():
        recording = _foot(folder / MARKERS, side)
        for label, method in RUNNER_METHODS.items():
            table = touchdown_table(recording, **SECTIONS, method=method)
            row = {"condition": f"runner's {name} foot against force", "method": label}
            rows.append(row | _compared(table, onsets[turn::2]))
    return rows


def _foot(path: Path, side: str) -> Recording:
    frame = pd.read_csv(path, sep="\t", skiprows=HEADER_LINES)
    names = ("body1", "body2", "body3", f"{side}_heel", f"{side}_mt1", f"{side}_mt5")
    columns = [[f"{name} {axis}" for axis in "XYZ"] for name in names]
    positions = np.stack([frame[c].to_numpy(float) / 1000 for c in columns], axis=1)
    positions[:, 3:, 2] -= AT_REST_M
    time = np.arange(len(frame)) / RUNNER_HZ
    return Recording(
        "runner", time, positions, names, ("body",) * 3 + ("foot",) * 3, RUNNER_HZ
    )


# Number of landings of runners' feet that are used, from the file to the states at both
# sections.

PELVIS, SOLE = ("R.ASIS", "L.ASIS", "R.PSIS"), ("Heel.Bottom", "MT1", "MT5")
RUNS = {
    "RBDS032 at 3.5 m/s": ("RBDS032runT35markers.txt", "y", PELVIS, SOLE, "."),
    "RBDS001 at 3.5 m/s": ("RBDS001runT35_markers.txt", "y", PELVIS, SOLE, "."),
    "RBDS001 at 2.5 m/s": (
        MARKERS,
        "z",
        ("body1", "body2", "body3"),
        ("heel", "mt1", "mt5"),
        "_",
    ),
}


def used_rows() -> list[dict[str, Any]]:
    """Return one row for each run and foot: its landings, and how many have a pair of states."""
    rows = []
    for run, (file, axis, body, sole, between) in RUNS.items():
        path = next((f / file for f in FOLDERS if (f / file).is_file()), None)
        for side in SIDES if path else ():
            markers = {
                "body": body,
                "feet": [f"{side}{between}{name}" for name in sole],
            }
            recording, _ = import_recording(
                [path], name=run, markers=markers, vertical_axis=axis
            )
            recording = level(recording, fit_floor(recording))
            landings = find_landings(recording)
            sections = select_sections(
                [recording], landings={run: landings}, frames="landings"
            )
            heights = {
                k: getattr(sections, k) for k in ("pre_height_m", "post_height_m")
            }
            table = touchdown_table(recording, landings=landings, **heights)
            pairs = assemble_pairs([recording], table, **heights)
            total = int((table["reason"] != NO_FOOT_LANDED).sum())
            name = f"{SIDES[side][1]} foot of {run}: landings used"
            row = {"condition": name, "method": "kink, learned", "landings": total}
            rows.append(row | {"found": len(pairs) / total})
    return rows


def _compared(table: pd.DataFrame, onsets: np.ndarray) -> dict[str, float]:
    contacts = table[[name for name in table if name.startswith("contact_")]]
    first = contacts.min(axis=1).dropna().to_numpy()
    away = np.abs(first[:, None] - onsets)
    late_ms = 1e3 * (first - onsets[away.argmin(axis=1)])[away.min(axis=1) < SAME_S]
    middle = float(np.median(late_ms))
    return {
        "landings": len(onsets),
        "found": len(late_ms) / len(onsets),
        "bias_ms": middle,
        "sd_ms": 1.4826 * float(np.median(np.abs(late_ms - middle))),
        "missed": int((away.min(axis=0) >= SAME_S).sum()),
        "invented": int((away.min(axis=1) >= SAME_S).sum()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument(
        "--seeds", type=int, default=5, help="simulated recordings (default 5)"
    )
    parser.add_argument("--landings", type=int, default=2860, help="landings of each")
    parser.add_argument(
        "--peer-landings", type=int, default=200, help="for scipy (default 200)"
    )
    parser.add_argument("--seed", type=int, default=1, help="first seed (default 1)")
    parser.add_argument(
        "--few", action="store_true", help="only the rows of few landings"
    )
    arguments = parser.parse_args()
    few = range(arguments.seed, arguments.seed + arguments.seeds)
    if arguments.few:
        write(pd.DataFrame(few_rows(few)), arguments.out)
        return
    warm = make(60, Condition(compliance_s=0.005), np.random.default_rng(0))
    ours(warm)  # compile before timing
    table = pd.DataFrame(
        [row for name in CONDITIONS for row in rows_of(name, arguments)]
    )
    loop = table[table["method"] == "scipy curve_fit loop, free"].set_index("condition")
    table["times_faster"] = (
        table["condition"].map(loop["us_per_fit"]) / table["us_per_fit"]
    )
    more = [*runner_rows(), *used_rows(), *few_rows(few)]
    write(pd.concat([table, pd.DataFrame(more)], ignore_index=True), arguments.out)


def write(table: pd.DataFrame, out: Path) -> None:
    """Write and print the rows."""
    table = table.reindex(columns=COLUMNS)
    out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(out, index=False, float_format="%.6g")
    print(table.round(3).to_string(index=False))


if __name__ == "__main__":
    main()
