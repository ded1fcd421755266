"""What the text leaves open (sections 1.2 and 2.4): items 99 and 100.

Two uses of a derivative through contacts that the dissertation names and does not try:
a filter whose covariance passes them, and optimisation by gradients. Each is tried on
the hopper beside the same method without saltation matrices, and where these do not
matter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.dissertation.rows import Agreement, Made, Row, over_seeds
from hopdata.hybrid import Solution, solve
from hopdata.hybrid.filtering import Estimate, SaltationFilter, confidence_limit
from hopdata.hybrid.first_order import (
    derivative_without_saltation,
    project_onto_section,
)
from hopdata.scenes import hopper_vector as at
from hopdata.scenes.body import CLIMB, YAW, flight_mode
from hopdata.scenes.hopper import hopper_system
from hopdata.scenes.hopper_parameters import HopperParameters

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HOPPER = HopperParameters()
N_FEET = HOPPER.n_legs
#: Tolerances of all integrations.
#: Unit: 1, and m, rad, and these per s. Origin: chosen.
OPTIONS: dict[str, Any] = {"rtol": 1e-8, "atol": 1e-12}


def make(seeds: Sequence[int]) -> Made:
    """Measure items 99 and 100."""
    tracked = over_seeds(track_all, seeds)
    optimised = over_seeds(optimise_both, seeds)
    tables = {
        "filter": pd.concat(tracked, ignore_index=True),
        "gradient": pd.concat(optimised, ignore_index=True),
    }
    rows = [filter_row(tables["filter"]), gradient_row(tables["gradient"])]
    return Made(rows, tables)


def draw(tables: Mapping[str, pd.DataFrame]) -> dict[str, Figure]:
    """Draw the errors of the filters, and how the optimisations converge."""
    from hopdata.dissertation.figures import open_questions as figures

    return {
        "filter_through_contacts": figures.filters(tables["filter"]),
        "gradient_through_contacts": figures.convergence(tables["gradient"]),
    }


# Item 99: a filter through contacts.

#: Share of the errors that a filter's confidence is to hold.
#: Unit: 1. Origin: convention.
CONFIDENCE = 0.95
#: Runs of the hopper that are tracked with each seed.
#: Unit: 1. Origin: chosen.
RUNS = 5


@dataclass(frozen=True)
class Tracking:
    """A hopper that is tracked from its apex through its contacts.

    Attributes
    ----------
    hopper
        The hopper.
    duration_s
        Time for which it is tracked.
    frames_hz
        Rate at which its pose is measured.
    position_sd_m, angle_sd_rad
        Noise of the measured pose.
    start_sd
        Errors of position (m), attitude (rad), velocity (m/s) and angular velocity
        (rad/s) at the start.
    push_sd_m_s, turn_sd_rad_s
        Random change of velocity and angular velocity from frame to frame.
    """

    hopper: HopperParameters = HOPPER
    duration_s: float = 1.2
    frames_hz: float = 50.0
    position_sd_m: float = 0.004
    angle_sd_rad: float = 0.015
    start_sd: tuple[float, ...] = (0.01, 0.02, 0.05, 0.1)
    push_sd_m_s: float = 0.004
    turn_sd_rad_s: float = 0.015

    @property
    def noise_sd(self) -> FloatArray:
        """Noise of the measured pose, (6,)."""
        return np.repeat([self.position_sd_m, self.angle_sd_rad], 3)

    @property
    def push_sd(self) -> FloatArray:
        """Random change of the state from frame to frame, (12,)."""
        return np.repeat([0.0, 0.0, self.push_sd_m_s, self.turn_sd_rad_s], 3)


HOPS = Tracking()
# Legs without preload or damper: their force is zero when they touch, so the field does
# not change there and the saltation matrices are 1. They land once.
SOFT_LEGS = replace(HOPPER, preload_n=0.0, stiffness_n_m=900.0, damping_n_s_m=0.0)
SOFT = Tracking(hopper=SOFT_LEGS, duration_s=0.36)


def track_all(seed: int) -> pd.DataFrame:
    """Track hoppers with either filter; a row for each run, filter and frame."""
    tables = []
    for name, tracking in (("hopper", HOPS), ("soft legs", SOFT)):
        for run in range(RUNS):
            table = track(tracking, [seed, 99, run])
            tables.append(table.assign(legs=name, seed=seed, run=run))
    return pd.concat(tables, ignore_index=True)


def track(tracking: Tracking, entropy: Sequence[int]) -> pd.DataFrame:
    """Track one run of the hopper by a filter with saltation matrices and one without.

    Returns
    -------
    DataFrame
        ``time_s`` of the frame, ``filtered_by`` ("saltation" or "none"), whether a foot
        has touched or left the floor since the last frame (``contact``), the normalised
        squared error of the ``prediction``, and the errors of velocity ``speed_m_s``
        and angular velocity ``turn_rad_s`` after the measurement.
    """
    rng = np.random.default_rng(np.random.SeedSequence(list(entropy)))
    truth = _Truth(tracking, rng)
    expected = truth.expected
    flying = flight_mode(hopper_system(), expected[CLIMB])
    sd = np.repeat(tracking.start_sd, 3)
    density = np.diag(tracking.push_sd**2 * tracking.frames_hz)
    filters = {}
    estimates = {}
    for name, saltation in (("saltation", True), ("none", False)):
        filters[name] = SaltationFilter(
            hopper_system(),
            params=tracking.hopper.vector(),
            noise_density=density,
            saltation=saltation,
            **OPTIONS,
        )
        estimates[name] = Estimate(0.0, expected, np.diag(sd**2), flying)
    # What is measured of a state: its first six components, position and attitude.
    pose = np.eye(6, 12)
    noise = np.diag(tracking.noise_sd**2)
    rows = []
    for frame in range(1, round(tracking.duration_s * tracking.frames_hz) + 1):
        time = frame / tracking.frames_hz
        is_contact = truth.go_on_to(time)
        measured = truth.state[:6] + tracking.noise_sd * rng.normal(size=6)
        for name, one in filters.items():
            predicted = one.predict(estimates[name], time)
            estimates[name] = one.update(predicted, measured, pose, noise)
            error = estimates[name].mean - truth.state
            row = {
                "time_s": time,
                "filtered_by": name,
                "contact": is_contact,
                "prediction": predicted.normalised_error(truth.state),
                "speed_m_s": float(np.linalg.norm(error[6:9])),
                "turn_rad_s": float(np.linalg.norm(error[9:])),
            }
            rows.append(row)
    return pd.DataFrame(rows)


@dataclass
class _Truth:
    """The hopper that is tracked, with the pushes that nobody knows of."""

    tracking: Tracking
    rng: np.random.Generator
    time: float = 0.0
    expected: FloatArray = field(init=False)
    state: FloatArray = field(init=False)
    mode: Any = field(init=False)

    def __post_init__(self) -> None:
        self.expected = apex_state()
        sd = np.repeat(self.tracking.start_sd, 3)
        self.state = self.expected + sd * self.rng.normal(size=12)
        self.mode = flight_mode(hopper_system(), self.state[CLIMB])

    def go_on_to(self, time: float) -> bool:
        """Move on to a time; return whether a foot has touched or left the floor."""
        is_contact = False
        while self.time < time:
            piece = solve(
                hopper_system(),
                (self.time, time),
                self.state,
                params=self.tracking.hopper.vector(),
                mode=self.mode.tolist(),
                **OPTIONS,
            )
            is_contact |= bool((piece.events.guard < N_FEET).any())
            self.time = piece.t_end
            self.state = piece.y_end
            self.mode = piece.mode
        self.state = self.state + self.tracking.push_sd * self.rng.normal(size=12)
        return is_contact


def apex_state() -> FloatArray:
    """Return a state just after an apex: 0.5 m high, moving and turning slowly."""
    state = np.zeros(12)
    state[2] = 0.5
    state[6:] = (0.05, -0.03, -0.01, 0.05, -0.1, 0.05)
    return state


def filter_row(table: pd.DataFrame) -> Row:
    """Return the row on the filter: whether its confidence is right at contacts."""
    values: dict[str, Any] = {
        "confidence": CONFIDENCE,
        "states": 12,
        "runs": RUNS,
        "rate": HOPS.frames_hz,
    }
    for legs, prefix in (("hopper", ""), ("soft legs", "soft_")):
        for name in ("saltation", "none"):
            own = table[(table["legs"] == legs) & (table["filtered_by"] == name)]
            values |= _by_seed(own, f"{prefix}{name}")
    held = np.median(values["saltation_held"])
    lost = np.median(values["none_held"])
    # Without saltation, several times as many errors must be beyond the confidence;
    # where the matrices are 1, both filters must be the same.
    is_better = (1 - lost) > 2 * (1 - held)
    differences = np.subtract(values["soft_saltation_held"], values["soft_none_held"])
    is_same = float(np.abs(differences).max()) < 1e-6
    agreement = Agreement.DIFFERS
    if is_better and is_same:
        agreement = Agreement.AGREES
    return Row(99, agreement, values, "confidence")


def _by_seed(table: pd.DataFrame, name: str) -> dict[str, list[float]]:
    """Return numbers of a filter for each seed, over the frames with a contact."""
    limit = confidence_limit(12, share=CONFIDENCE)
    at_contacts = table[table["contact"]].groupby("seed", sort=False)
    elsewhere = table[~table["contact"]].groupby("seed", sort=False)

    def held(errors: pd.Series) -> float:
        """Return the share of squared errors that the confidence holds."""
        return float((errors < limit).mean())

    within = at_contacts["prediction"].agg(held)
    others = elsewhere["prediction"].agg(held)
    squares = at_contacts["turn_rad_s"].agg(lambda found: float((found**2).mean()))
    return {
        f"{name}_held": within.tolist(),
        f"{name}_elsewhere": others.tolist(),
        f"{name}_error": at_contacts["prediction"].median().tolist(),
        f"{name}_turn": np.sqrt(squares).tolist(),
    }


# Item 100: a gradient through contacts.

#: Most evaluations of the objective, each with its gradient.
#: Unit: 1. Origin: chosen.
EVALUATIONS = 28
#: Miss at which the target counts as reached.
#: Unit: cm, degrees. Origin: chosen: a hundredth of a millimetre.
REACHED = 1e-3
# What is chosen for a hop, and within which limits (Sec. 3.3): the swing of the boom,
# rad, and the preload of each leg, as a share of what it is.
SWING_LIMIT_RAD = np.radians(67.5)
PRELOAD_LIMIT = 0.2
CHOSEN = (
    at.BOOM_SWING,
    *(at.LEGS + at.LEG_STRIDE * leg + at.PRELOAD for leg in range(N_FEET)),
)
LIMITS = np.array([SWING_LIMIT_RAD, *(PRELOAD_LIMIT * HOPPER.preload_n,) * N_FEET])
# The first guess. The boom swings a little: while it rests, the state tells the step
# control nothing of its move, and the derivative by the swing is 1 % off.
FIRST = np.array([0.1, 0.0, 0.0, 0.0])
# Where the next apex is to be: x, y (m) and heading (rad), in units of 1 cm and 1
# degree.
OUTCOME = (0, 1, YAW)
UNITS = np.array([0.01, 0.01, np.radians(1.0)])
# What is asked for, by the number of these coordinates.
PLACE = "place"
HEADING = "place and heading"
GOALS = {PLACE: 2, HEADING: 3}
#: Largest hidden choice that a target is drawn from, as a share of the limits.
#: Unit: 1. Origin: measured: docs/gradients.md. At 0.6 some targets have local minima
#: at the limits, at which any optimiser with a right gradient stops.
HIDDEN = 0.3
# What the optimiser knows of contacts.
THROUGH = "through contacts"
IGNORED = "contacts ignored"


def hop_from(choice: FloatArray) -> tuple[Solution, FloatArray]:
    """Return a hop to the next apex, and its parameters.

    Parameters
    ----------
    choice : (4,) array
        Swing and preloads, each as a share of its limit, -1 to 1.
    """
    params = parameters(choice)
    hop = solve(hopper_system(), (0.0, 2.0), START, params=params, mode=MODE, **OPTIONS)
    return hop, params


def parameters(choice: FloatArray) -> FloatArray:
    """Return the hopper's parameters for a choice, as shares of the limits."""
    params = HOPPER.vector()
    params[list(CHOSEN)] += LIMITS * choice
    return params


# A hop that starts tilted and moving, so that its feet touch one after the other.
START = np.zeros(12)
START[2:6] = (0.5, 0.0, 0.03, -0.02)
START[6:9] = (0.2, 0.0, -1e-6)
MODE = flight_mode(hopper_system(), -1.0).tolist()


def apex_slopes(choice: FloatArray, through: bool) -> tuple[FloatArray, FloatArray]:
    """Return the outcome of a hop (3,) and its derivative (3, 4), in their units.

    The apex comes at another time for another choice, so the derivative at a fixed time
    is projected onto the section on which the climb rate is zero.
    """
    options: dict[str, Any] = {
        "params": parameters(choice),
        "mode": MODE,
        "jacobian": "params",
        **OPTIONS,
    }
    if through:
        hop = solve(hopper_system(), (0.0, 2.0), START, **options)
        of_params = hop.sensitivity
    else:
        hop, _, of_params = derivative_without_saltation(
            hopper_system(), (0.0, 2.0), START, **options
        )
    assert of_params is not None
    rate = np.zeros(12)
    system = hopper_system()
    system.field.function(hop.t_end, hop.y_end, hop.mode, options["params"], rate)
    is_apex = np.zeros(12)
    is_apex[CLIMB] = 1.0
    slopes = project_onto_section(of_params, rate, is_apex)
    of_choice = slopes[np.ix_(OUTCOME, CHOSEN)] * LIMITS / UNITS[:, None]
    return hop.y_end[list(OUTCOME)] / UNITS, of_choice


def slopes_by_differences(choice: FloatArray, step: float = 1e-4) -> FloatArray:
    """Return the derivative (3, 4) of a hop's outcome by central differences."""
    columns = []
    for shift in step * np.eye(len(CHOSEN)):
        ahead = hop_from(choice + shift)[0].y_end[list(OUTCOME)]
        behind = hop_from(choice - shift)[0].y_end[list(OUTCOME)]
        columns.append((ahead - behind) / (2 * step) / UNITS)
    return np.array(columns).T


def optimise_both(seed: int) -> pd.DataFrame:
    """Let L-BFGS-B find the choice that reaches a drawn target, with either gradient.

    Returns
    -------
    DataFrame
        A row for each evaluation: ``goal`` ("place" or "place and heading"),
        ``gradient``, ``evaluation`` from 1 on, ``miss`` (cm and degrees), the best so
        far ``best``, and the gradient's relative error at the start (``error``).
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, 100]))
    hidden = rng.uniform(-HIDDEN, HIDDEN, len(CHOSEN))
    target = hop_from(hidden)[0].y_end[list(OUTCOME)] / UNITS
    exact = slopes_by_differences(FIRST)
    tables = []
    for name, through in ((THROUGH, True), (IGNORED, False)):
        _, found = apex_slopes(FIRST, through)
        error = np.abs(found - exact).max() / np.abs(exact).max()
        for goal, n_wanted in GOALS.items():
            missed = misses(target[:n_wanted], through)
            rows = {
                "seed": seed,
                "goal": goal,
                "gradient": name,
                "evaluation": np.arange(1, len(missed) + 1),
                "miss": missed,
                "best": np.minimum.accumulate(missed),
                "error": error,
            }
            tables.append(pd.DataFrame(rows))
    return pd.concat(tables, ignore_index=True)


def misses(target: FloatArray, through: bool) -> FloatArray:
    """Return the misses (N,) of the hops that L-BFGS-B tries to reach a target.

    Parameters
    ----------
    target : (k,) array
        The first k coordinates of the outcome, in their units.
    through : bool
        Whether the gradient goes through contacts, or ignores them.
    """
    from scipy.optimize import minimize

    found: list[float] = []

    def cost(choice: FloatArray) -> tuple[float, FloatArray]:
        reached, slopes = apex_slopes(choice, through)
        off = reached[: len(target)] - target
        found.append(float(np.linalg.norm(off)))
        return 0.5 * float(off @ off), slopes[: len(target)].T @ off

    minimize(
        cost,
        FIRST,
        jac=True,
        method="L-BFGS-B",
        bounds=[(-1.0, 1.0)] * len(CHOSEN),
        options={"maxfun": EVALUATIONS, "ftol": 1e-11, "gtol": REACHED},
    )
    return np.array(found[:EVALUATIONS])


def gradient_row(table: pd.DataFrame) -> Row:
    """Return the row on the gradient: error, evaluations, and what is left."""
    heading = table[table["goal"] == HEADING]
    first = heading[heading["evaluation"] == 1].groupby("seed", sort=False)
    values: dict[str, Any] = {
        "evaluations": EVALUATIONS,
        "reached": REACHED,
        "start": first["miss"].first().tolist(),
        "targets": table["seed"].nunique(),
    }
    for name, gradient in (("through", THROUGH), ("ignored", IGNORED)):
        own = table[table["gradient"] == gradient]
        values[f"{name}_error"] = (
            own.groupby("seed", sort=False)["error"].first().tolist()
        )
        for prefix, goal in ((name, HEADING), (f"{name}_place", PLACE)):
            runs = own[own["goal"] == goal].groupby("seed", sort=False)["best"]
            values[f"{prefix}_miss"] = runs.min().tolist()
            values[f"{prefix}_needed"] = [_needed(best) for _, best in runs]
            values[f"{prefix}_successes"] = int((runs.min() < REACHED).sum())
    right = max(values["through_error"]) < 1e-4 < min(values["ignored_error"])
    successes = values["through_successes"]
    agreement = Agreement.DIFFERS
    if right and successes > values["ignored_successes"]:
        agreement = Agreement.PARTLY
        all_places = values["through_place_successes"] == values["targets"]
        if successes == values["targets"] and all_places:
            agreement = Agreement.AGREES
    return Row(100, agreement, values, "out_of_the_box")


def _needed(best: pd.Series) -> int:
    """Return the evaluations until the target was reached; all if it was not."""
    reached = np.flatnonzero(best.to_numpy() < REACHED)
    if len(reached) == 0:
        return EVALUATIONS
    return int(reached[0]) + 1
