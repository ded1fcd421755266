"""The claims about the frame change: agnostic, zero-order, 100 hops, turns and drift.

The simulated robot knows its contacts and its state, so each claim can be put to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.dissertation.figures import frame_change_claims as figures
from hopdata.dissertation.rows import Agreement, Made, Row, over_seeds
from hopdata.rigid import composed, relative
from hopdata.scenes.scene import Control
from hopdata.steering import robot as plant
from hopdata.steering import turning
from hopdata.steering.excitation import ControlGrid, eulerian_excitation
from hopdata.steering.models import by_schedule, residuals
from hopdata.steering.models.learning import IN_UNITS
from hopdata.steering.strides import COMPONENTS
from hopdata.steering.true_hops import TrueHops, true_hops
from hopdata.synthesis.trial import Kicks

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Effort:
    """How much is computed: a test asks for less than the page.

    Parameters
    ----------
    sizes : tuple of int
        Numbers of hops to learn from.
    fresh : int
        Hops that are predicted.
    order_hops : int
        Hops by which the orders are judged.
    permutations : int
    scaled_hops : int
        Hops of each size of the kicks.
    turn_hops : int
        Hops of each sustained turn.
    """

    sizes: tuple[int, ...] = by_schedule.SIZES
    fresh: int = 300
    order_hops: int = 1200
    permutations: int = 199
    scaled_hops: int = 270
    turn_hops: int = 40


# What the dissertation prints, with its section.
SCHEDULES = 36  # 3.4.2, footnote 7: six orders to leave the floor, six to touch it
PRINTED_HOPS = 100  # 3.4.2
PRINTED_RADIUS_M = 0.6  # 3.5
FIGURE_SWING_DEG = 45.0  # Fig. 3.3

#: Swings of the sustained turns: up to the limit of the simulated robot, in thirds.
#: Unit: degrees. Origin: derived: from `SteeredHopper.swing_limit_rad`.
SWINGS_DEG = (-67.5, -45.0, -22.5, 0.0, 22.5, 45.0, 67.5)
#: Sizes of the kicks, as shares of the robot's, between which an effect must fall.
#: Unit: 1. Origin: chosen.
KICK_SCALES = (1.0, 0.25)
HOPPER = "hopper"
COUPLED = "coupled legs"
#: Coupling of the legs of the control, whose landings are not C1.
#: Unit: 1. Origin: chosen.
CONTROL_COUPLING = 0.3
BODIES: Mapping[str, Control | None] = {
    HOPPER: None,
    COUPLED: Control(coupling=CONTROL_COUPLING),
}
#: Poses and frame changes with which the update equation is compared.
#: Unit: 1. Origin: chosen.
POSES = 1000
#: Largest difference between equations that are the same.
#: Unit: m and rad. Origin: rounding: a thousand times that of poses of a few metres.
SAME_EQUATION = 1e-12
#: Largest difference between frame changes that do not depend on the place.
#: Unit: m. Origin: rounding: far above the integrator's error, far below any noise.
SAME_PLACE_M = 1e-6
#: How far a turning radius may be from the printed one, as a share of it, to agree.
#: Unit: 1. Origin: chosen.
RADIUS_WITHIN = 0.25
#: Power of the spread above which an effect is taken to be of second order.
#: Unit: 1. Origin: derived: between 1, that of first order, and 2, that of second.
FIRST_ORDER_BELOW = 1.5
#: Share of its variance that boom angle and swing decide of a zero-order frame change.
#: Unit: 1. Origin: chosen.
ZERO_ORDER = 0.9
#: Largest p of a permutation test by which contact orders tell of a frame change.
#: Unit: 1. Origin: convention: 1 %.
SIGNIFICANT = 0.01
#: A model of 100 hops suffices if it errs at most so much more than one of all hops.
#: Unit: 1. Origin: chosen.
SUFFICIENT = 1.2


def make(seeds: Sequence[int], *, effort: Effort | None = None) -> Made:
    """Measure items 54, 55, 64, 79 and 80."""
    effort = effort or Effort()
    robot = plant.SteeredHopper()

    def of_seed(seed: int) -> dict[str, pd.DataFrame]:
        bodies: Mapping[str, Control | None] = {HOPPER: None}
        if seed == seeds[0]:  # one seed tells the control from the hopper
            bodies = BODIES
        return _of_seed(robot, seed, effort, bodies)

    found = over_seeds(of_seed, seeds)
    tables = {}
    for name in found[0]:
        of_seeds = [
            one[name].assign(seed=seed) for seed, one in zip(seeds, found, strict=True)
        ]
        tables[name] = pd.concat(of_seeds, ignore_index=True)
    rows = [
        equation_row(tables, int(seeds[0])),
        zero_order_row(robot, tables),
        schedules_row(tables, effort),
        radius_row(tables),
        drift_row(robot, tables, effort),
    ]
    return Made(rows, tables)


def draw(tables: Mapping[str, pd.DataFrame]) -> Mapping[str, Figure]:
    """Draw the part's figures."""
    return {
        "orders_and_state": figures.orders_figure(
            tables["decided"], tables["orders"], tables["scaled"]
        ),
        "model_by_schedule": figures.schedules_figure(tables["curve"]),
        "turning": figures.turning_figure(tables["turns"]),
    }


def _of_seed(
    robot: plant.SteeredHopper,
    seed: int,
    effort: Effort,
    bodies: Mapping[str, Control | None],
) -> dict[str, pd.DataFrame]:
    """Return the tables of one seed."""
    needed = max(max(effort.sizes) + effort.fresh, effort.order_hops)
    hops = excited_hops(robot, needed, seed)
    judged = hops.rows(slice(0, effort.order_hops))
    orders = residuals.order_effects(
        judged, seed=seed, permutations=effort.permutations
    )
    curve = by_schedule.schedule_curve(
        hops, effort.sizes, fresh=effort.fresh, seed=seed
    )
    most = hops.rows(slice(0, max(effort.sizes)))
    names, counts = np.unique(most.schedule, return_counts=True)
    return {
        "decided": residuals.decided_by(judged),
        "orders": orders,
        "scaled": _scaled(robot, seed, effort, bodies),
        "curve": curve,
        "schedules": pd.DataFrame({"schedule": names, "hops": counts}),
        "turns": _turns(robot, seed, effort),
    }


def excited_hops(robot: plant.SteeredHopper, needed: int, seed: int) -> TrueHops:
    """Return at least this many hops with the dissertation's grid of swings."""
    rng = np.random.default_rng([seed, 0])
    one_lap = ControlGrid(repeats=1)
    per_lap = one_lap.n_angles * len(one_lap.steps)
    # One more than needed, since the first has none before it; and some for falls.
    repeats = int(np.ceil((needed + 2) / per_lap))
    swings = eulerian_excitation(ControlGrid(repeats=repeats), rng)
    return true_hops(robot, swings[: needed + 2], seed=seed)


def _scaled(
    robot: plant.SteeredHopper,
    seed: int,
    effort: Effort,
    bodies: Mapping[str, Control | None],
) -> pd.DataFrame:
    """Return what the order adds by size of the kicks, with the boom at rest."""
    even = (1.0,) * robot.hopper.n_legs
    rows = []
    for name, control in bodies.items():
        for scale in KICK_SCALES:
            kicks = Kicks(
                velocity_m_s=scale * robot.kicks.velocity_m_s,
                angular_velocity_rad_s=scale * robot.kicks.angular_velocity_rad_s,
                preload_fraction=0.0,
            )
            kicked = replace(robot, kicks=kicks, preload_shares=even)
            rest = np.zeros(effort.scaled_hops)
            hops = true_hops(kicked, rest, seed=seed, control=control)
            effect, spread = residuals.order_gain(hops)
            for k, component in enumerate(COMPONENTS):
                rows.append(
                    {
                        "body": name,
                        "scale": scale,
                        "component": component,
                        "effect": effect[k] * IN_UNITS[k],
                        "spread": spread[k] * IN_UNITS[k],
                    }
                )
    return pd.DataFrame(rows)


def _turns(robot: plant.SteeredHopper, seed: int, effort: Effort) -> pd.DataFrame:
    """Return the sustained turns by swing."""
    rows = []
    for swing_deg in SWINGS_DEG:
        turn = turning.sustained_turn(
            robot, np.radians(swing_deg), seed=seed, hops=effort.turn_hops
        )
        rows.append(
            {
                "swing_deg": swing_deg,
                "turn_deg": np.degrees(turn.turn_rad),
                "step_m": turn.step_m,
                "radius_m": turn.radius_m,
            }
        )
    return pd.DataFrame(rows)


# Item 54: the update equation, and that it does not depend on the schedule.


def equation_row(tables: Mapping[str, pd.DataFrame], seed: int) -> Row:
    """Judge item 54: the update equation, and that it does not depend on schedules."""
    scaled = tables["scaled"]
    powers = {name: _powers(scaled, name) for name in BODIES}
    equation = equation_error(seed)
    is_agnostic = min(powers[HOPPER]) > FIRST_ORDER_BELOW
    orders = tables["orders"]
    # The printed equation knows boom angle and swing alone.
    blind = orders[orders["given"] == residuals.INPUTS]
    tells = float(blind["p"].max()) < SIGNIFICANT
    agreement = Agreement.DIFFERS
    if equation < SAME_EQUATION and is_agnostic and not tells:
        agreement = Agreement.AGREES
    elif equation < SAME_EQUATION or is_agnostic:
        agreement = Agreement.PARTLY
    return Row(
        item=54,
        agreement=agreement,
        values={
            "equation_error": equation,
            "power": powers[HOPPER],
            "control_power": powers[COUPLED],
            **_effects(orders, residuals.INPUTS, "without"),
            **_effects(orders, residuals.STATE, "with"),
        },
        reason="second_order" if is_agnostic else "first_order",
    )


def equation_error(seed: int) -> float:
    """Return the largest difference of the printed update equation from `composed`.

    The printed equation is written out here, component by component (Sec. 3.4.1).
    """
    rng = np.random.default_rng([seed, 1])
    x, y, theta = pose = rng.uniform(-3.0, 3.0, (3, POSES))
    dx, dy, dtheta = change = rng.uniform(-0.3, 0.3, (3, POSES))
    printed = np.array(
        [
            x + dx * np.cos(theta) - dy * np.sin(theta),
            y + dx * np.sin(theta) + dy * np.cos(theta),
            theta + dtheta,
        ]
    )
    after = composed(pose.T, change.T)
    forward = np.abs(printed.T - after).max()
    back = np.abs(relative(pose.T, after) - change.T).max()
    return float(max(forward, back))


def _powers(scaled: pd.DataFrame, body: str) -> list[float]:
    """Return, for each seed, the power of the spread with which the effect falls.

    It is the mean over x and y.
    """
    rows = scaled[(scaled["body"] == body) & (scaled["component"] != COMPONENTS[2])]
    powers = []
    for _, own in rows.groupby("seed"):
        effect = own.pivot_table(index="component", columns="scale", values="effect")
        spread = own.pivot_table(index="component", columns="scale", values="spread")
        large, small = KICK_SCALES
        fall = np.log(effect[large] / effect[small])
        powers.append(float((fall / np.log(spread[large] / spread[small])).mean()))
    return powers


def _effects(orders: pd.DataFrame, given: str, name: str) -> dict[str, list[float]]:
    """Return the larger effect of both orders for each seed, by component."""
    rows = orders[orders["given"] == given]
    largest = rows.groupby(["component", "seed"])["effect"].max()
    short = dict(zip(COMPONENTS, ("x", "y", "heading"), strict=True))
    return {f"{name}_{short[c]}": largest[c].tolist() for c in COMPONENTS}


# Item 55: zero-order.


def zero_order_row(
    robot: plant.SteeredHopper, tables: Mapping[str, pd.DataFrame]
) -> Row:
    """Judge item 55: whether boom angle and swing alone decide a frame change."""
    decided = tables["decided"]
    orders = tables["orders"]
    values: dict[str, Any] = {"place_mm": 1e3 * place_error_m(robot)}
    short = {
        residuals.BY_INPUTS: "inputs",
        residuals.BY_HISTORY: "history",
        residuals.BY_MOMENTUM: "momentum",
        residuals.BY_STATE: "state",
    }
    axes = dict(zip(COMPONENTS, ("x", "y", "heading"), strict=True))
    for known, name in short.items():
        for component, axis in axes.items():
            is_own = (decided["known"] == known) & (decided["component"] == component)
            values[f"{name}_{axis}"] = (100 * decided.loc[is_own, "share"]).tolist()
    blind = orders[orders["given"] == residuals.INPUTS]
    for order, name in (("landing", "landing"), ("lift-off", "lift_off")):
        own = blind[blind["order"] == order]
        values[f"{name}_least"] = (100 * own.groupby("seed")["share"].min()).tolist()
        values[f"{name}_most"] = (100 * own.groupby("seed")["share"].max()).tolist()
    values["largest_p"] = float(blind["p"].max())
    by_inputs = decided[decided["known"] == residuals.BY_INPUTS]
    share = by_inputs.groupby("component")["share"].median()
    is_placeless = values["place_mm"] < 1e3 * SAME_PLACE_M
    n_zero_order = int((share >= ZERO_ORDER).sum())
    agreement = Agreement.PARTLY
    reason = "momentum"
    if is_placeless and n_zero_order == len(COMPONENTS):
        agreement = Agreement.AGREES
        reason = ""
    elif not is_placeless and n_zero_order == 0:
        agreement = Agreement.DIFFERS
    return Row(item=55, agreement=agreement, values=values, reason=reason)


def place_error_m(robot: plant.SteeredHopper, *, hops: int = 5) -> float:
    """Return how much frame changes differ if the same hops begin somewhere else, m."""
    still = robot.still()
    swings = np.radians([30.0, -50.0, 60.0, 0.0, -20.0])[:hops]
    changes: list[FloatArray] = []
    for pose in ((0.0, 0.0, 0.0), (0.8, -0.7, 2.0)):
        apex = plant.released(still, pose)
        stances = []
        for swing in swings:
            hop = plant.steer_hop(still, apex, swing, rng=np.random.default_rng(0))
            stances.append(hop.stance.pose)
            apex = hop.end
        poses = np.array(stances)
        changes.append(relative(poses[:-1], poses[1:]))
    return float(np.abs(changes[0] - changes[1])[:, :2].max())


# Item 64: a model for each schedule.


def schedules_row(tables: Mapping[str, pd.DataFrame], effort: Effort) -> Row:
    """Judge item 64: 100 hops for one model, 3,600 for one a schedule."""
    curve = tables["curve"]
    last = max(effort.sizes)
    first = min(effort.sizes)
    by_seed = curve.groupby("seed")
    values: dict[str, Any] = {"first": first, "last": last}
    short = dict(zip(COMPONENTS, ("x", "y", "heading"), strict=True))
    for component, axis in short.items():
        own = curve[curve["component"] == component]
        for model, name in (
            (by_schedule.AGNOSTIC, "all"),
            (by_schedule.KNOWN, "told"),
            (by_schedule.UNKNOWN, "untold"),
        ):
            rows = own[own["model"] == model]
            for size, when in ((first, "first"), (last, "last")):
                errors = rows.loc[rows["hops"] == size, "rmse"]
                values[f"{name}_{when}_{axis}"] = errors.tolist()
        values[f"crossing_{axis}"] = [
            by_schedule.crossing(one, component) for _, one in by_seed
        ]
        values[f"untold_crossing_{axis}"] = [
            by_schedule.crossing(one, component, by_schedule.UNKNOWN)
            for _, one in by_seed
        ]
    schedules = tables["schedules"]
    of_seed = schedules.groupby("seed")["hops"]
    values["schedules"] = of_seed.size().tolist()
    values["possible"] = SCHEDULES
    enough = [int((own >= PRINTED_HOPS).sum()) for _, own in of_seed]
    values["with_100"] = enough
    values["commonest"] = [float(100 * own.max() / own.sum()) for _, own in of_seed]
    suffices = all(
        np.median(values[f"all_first_{axis}"])
        <= SUFFICIENT * np.median(values[f"all_last_{axis}"])
        for axis in short.values()
    )
    never = all(
        np.isinf(np.median(values[f"untold_crossing_{axis}"]))
        for axis in short.values()
    )
    told_never = all(
        np.isinf(np.median(values[f"crossing_{axis}"])) for axis in short.values()
    )
    agreement = Agreement.DIFFERS
    if suffices and never and told_never:
        agreement = Agreement.AGREES
    elif suffices or never:
        agreement = Agreement.PARTLY
    reason = "told" if never and not told_never else "sooner"
    if agreement is Agreement.AGREES:
        reason = ""
    values["untold_better"] = sum(
        int(np.isfinite(values.pop(f"untold_crossing_{axis}")).sum())
        for axis in short.values()
    )
    values["curves"] = len(short) * len(of_seed)
    # A crossing beyond the largest size is shown as this size.
    for axis in short.values():
        crossings = np.minimum(values[f"crossing_{axis}"], last)
        values[f"crossing_{axis}"] = crossings.tolist()
    return Row(item=64, agreement=agreement, values=values, reason=reason)


# Items 79 and 80: turning radius, counter-clockwise turns, clockwise drift.


def radius_row(tables: Mapping[str, pd.DataFrame]) -> Row:
    """Judge item 79: the turning radius."""
    turns = tables["turns"]
    of_figure = turns[turns["swing_deg"].abs() == FIGURE_SWING_DEG]
    radius = of_figure.groupby("seed")["radius_m"].mean()
    largest = turns["swing_deg"].abs().max()
    tightest = turns[turns["swing_deg"].abs() == largest]
    off = abs(float(radius.median()) / PRINTED_RADIUS_M - 1)
    agreement = Agreement.DIFFERS
    if off <= RADIUS_WITHIN:
        agreement = Agreement.AGREES
    turn_deg = of_figure.groupby("seed")["turn_deg"].apply(lambda one: one.abs().mean())
    return Row(
        item=79,
        agreement=agreement,
        values={
            "radius_m": radius.tolist(),
            "swing_deg": FIGURE_SWING_DEG,
            "tightest_m": tightest.groupby("seed")["radius_m"].mean().tolist(),
            "tightest_deg": float(largest),
            "half_turn_hops": (180.0 / turn_deg).tolist(),
        },
        reason="swing",
    )


def drift_row(
    robot: plant.SteeredHopper, tables: Mapping[str, pd.DataFrame], effort: Effort
) -> Row:
    """Judge item 80: weak turns to the left, and a drift to the right."""
    turns = tables["turns"]
    largest = turns["swing_deg"].abs().max()
    # The body turns against the boom.
    left = turns.loc[turns["swing_deg"] == -largest, "turn_deg"].abs()
    right = turns.loc[turns["swing_deg"] == largest, "turn_deg"].abs()
    drift = turns.loc[turns["swing_deg"] == 0.0, "turn_deg"]
    even = replace(robot.still(), preload_shares=(1.0,) * robot.hopper.n_legs)
    of_even = turning.sustained_turn(even, np.radians(largest), hops=effort.turn_hops)
    against = turning.sustained_turn(even, -np.radians(largest), hops=effort.turn_hops)
    is_clockwise = float(drift.median()) < 0
    is_weak = float(left.median()) < float(right.median())
    agreement = Agreement.DIFFERS
    if is_clockwise and is_weak:
        agreement = Agreement.AGREES
    elif is_clockwise or is_weak:
        agreement = Agreement.PARTLY
    return Row(
        item=80,
        agreement=agreement,
        values={
            "left_deg": left.tolist(),
            "right_deg": right.tolist(),
            "drift_deg": drift.tolist(),
            "even_left_deg": float(np.degrees(against.turn_rad)),
            "even_right_deg": float(-np.degrees(of_even.turn_rad)),
        },
        reason="uneven" if agreement is not Agreement.AGREES else "chosen",
    )
