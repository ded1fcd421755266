"""Chapter IV, what is proven and its experiment: orders, Theorem 4.2.1, Figure 4.2.

Every error is against an exact solution. In a sweep over steps (Fig. 4.2), the place of
the events within their steps decides a good deal of the error. The dissertation does
not say where its first steps ended, so that they are drawn, with each of the seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.dissertation.rows import Agreement, Made, Row, over_seeds
from hopdata.errors import AnalysisError
from hopdata.hybrid import solve
from hopdata.hybrid.printed import (
    AS_PRINTED,
    PrintedOptions,
    dopri5_step,
    hermite,
    heun3_step,
    integrate,
    region_of,
    rk4_step,
)
from hopdata.hybrid.printed.order import (
    LOOSE,
    equal_steps,
    fit_limit,
    fit_order,
    order_of_step,
)
from hopdata.hybrid.printed.theorem import (
    MESHES,
    Ends,
    KnownEvent,
    Localisation,
    localise,
    mesh_ends,
    turning_point,
)
from hopdata.scenes.octant import (
    INITIAL_STATE,
    T_SPAN,
    octant,
    octant_crossings,
    octant_end,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Slope of the error over the step that section 4.4.2 prints.
#: Unit: 1. Origin: convention: a number of the dissertation.
PRINTED_SLOPE = 4.2
#: The order that a third-order localisation and a third-order step once an event give.
#: Unit: 1. Origin: derived: both are wrong by dt^4, a fixed number of times.
EXPECTED_SLOPE = 4.0
#: Distance from a whole number within which a measured order counts as that number.
#: Unit: 1. Origin: chosen: next terms of the error's expansion shift it by less.
SAME_ORDER = 0.15
#: Standard errors within which a fitted slope agrees with a number.
#: Unit: 1. Origin: convention: three, as for a normal error.
STANDARD_ERRORS = 3.0
#: Longest step of a sweep, in which all events share one step.
#: Unit: 1. Origin: derived: the length of the span; time has no dimension.
LONGEST = 0.5
#: Shortest step of a sweep, near which rounding begins to show in the errors.
#: Unit: 1. Origin: chosen.
SHORTEST = 5e-4
#: Number of steps of a sweep: ten a decade.
#: Unit: 1. Origin: chosen.
N_STEPS = 31
#: Sweeps of each seed, with different first steps.
#: Unit: 1. Origin: chosen: with fewer, the curve is too ragged for a line.
SWEEPS = 16
#: Steps of a decade, over which slopes of single sweeps are taken.
#: Unit: 1. Origin: derived: from `N_STEPS` over three decades.
DECADE = 10

Run = Callable[[float, float], FloatArray]  # longest and first step: final state


def make(seeds: Sequence[int]) -> Made:
    """Measure the items 81 to 84 and 93."""
    theorem = theorem_table()
    steps = np.geomspace(LONGEST, SHORTEST, N_STEPS)
    sweeps = {}
    for name, run in runs().items():
        used = steps
        if name == "corrected":
            # In shorter steps there is one event at most, and nothing to correct.
            used = steps[steps > shortest_piece()]
        sweeps[name] = swept(run, seeds, used)
    errors = error_table(sweeps)
    slopes = slope_table(sweeps["printed"])
    rows = [
        order_row(),
        spline_row(),
        theorem_row(theorem),
        constants_row(),
        figure_row(sweeps, errors, slopes),
    ]
    return Made(rows, {"theorem": theorem, "errors": errors, "slopes": slopes})


def draw(tables: Mapping[str, pd.DataFrame]) -> Mapping[str, Figure]:
    """Draw Figure 4.2, and the theorem's bound beside the errors."""
    from hopdata.dissertation.figures.order import order_figure, theorem_figure

    return {
        "fig4_2_order": order_figure(tables["errors"], tables["slopes"]),
        "theorem_4_2_1": theorem_figure(tables["theorem"]),
    }


# Definitions 4.2.1 and 4.2.2.


def order_row() -> Row:
    """Measure the order of one-step methods as Definition 4.2.1 has it (item 81)."""
    values: dict[str, Any] = {
        "heun": _order(heun3_step, 0.05),
        "rk4": _order(rk4_step, 0.1),
        "dopri5": _order(dopri5_step, 0.2),
        "own": _order(_own_step, 0.2),
    }
    nominal = {"heun": 3.0, "rk4": 4.0, "dopri5": 5.0, "own": 5.0}
    holds = all(abs(values[name] - nominal[name]) < SAME_ORDER for name in nominal)
    return Row(81, _built(holds), values)


def _order(one_step: Callable[..., FloatArray], longest: float) -> float:
    """Return a method's order on y' = y cos t, from four steps."""
    steps = np.asarray(longest / 2.0 ** np.arange(4), dtype=np.float64)
    return order_of_step(one_step, _growing, _grown, steps, start=0.4)


def _growing(t: float, y: FloatArray) -> FloatArray:
    return y * np.cos(t)


def _grown(t: float) -> FloatArray:
    return np.array([np.exp(np.sin(t))])


def _own_step(_slope: object, t: float, y: FloatArray, dt: float) -> FloatArray:
    """Take one step of `hopdata.hybrid.solve` by its DOPRI5 on the same equation."""
    from hopdata.hybrid import System, field

    @field(compiled=False)
    def growing(t, y, mode, params, dy):  # type: ignore[no-untyped-def] # noqa: ARG001
        dy[0] = y[0] * np.cos(t)

    system = System(growing, n_states=1)
    options: dict[str, Any] = {**LOOSE, "first_step": dt, "max_step": dt}
    return solve(system, (t, t + dt), y, method="dopri5", **options).y_end


def spline_row() -> Row:
    """Measure the order of a Hermite spline on four meshes (item 82)."""
    event = turning_point()
    values = {
        "exact": _spline_order(partial(_ends, event, "exact")),
        "dopri5": _spline_order(partial(_ends, event, "dopri5")),
        "heun3": _spline_order(partial(_ends, event, "heun3")),
        "euler": _spline_order(partial(_euler_ends, event)),
        "cubic": _error_on_a_cubic(),
    }
    third = all(abs(values[mesh] - 3.0) < SAME_ORDER for mesh in MESHES)
    if third and values["euler"] < 3.0 - SAME_ORDER:
        return Row(82, Agreement.AGREES, values)
    return Row(82, Agreement.DIFFERS, values, "order")


def _ends(event: KnownEvent, mesh: str, dt: float) -> Ends:
    return mesh_ends(event, event.time, dt, mesh)


def _euler_ends(event: KnownEvent, dt: float) -> Ends:
    """Return the ends of a step of Euler's method, which is of first order."""
    y0, _, f0, _ = _ends(event, "exact", dt)
    y1 = y0 + dt * f0
    return y0, y1, f0, event.slope(event.time + dt, y1)


def _spline_order(ends: Callable[[float], Ends]) -> float:
    """Return the order of the spline through a step's ends: its slope, less one."""
    event = turning_point()
    steps = 0.2 / 2.0 ** np.arange(5)
    errors = []
    for dt in steps.tolist():
        between = ends(dt)
        largest = 0.0
        for theta in np.linspace(0.0, 1.0, 33).tolist():
            exact = event.derivative(0, np.array(event.time + theta * dt))
            found = hermite(theta, *between, dt)
            largest = max(largest, float(np.abs(found - exact).max()))
        errors.append(largest)
    slope, _ = np.polyfit(np.log(steps), np.log(errors), 1)
    return float(slope) - 1.0


def _error_on_a_cubic() -> float:
    """Return the largest error of the formula on the cubic that it should repeat."""
    cubic = np.polynomial.Polynomial([0.3, -1.1, 0.7, 2.0])
    slope = cubic.deriv()
    start = 0.2
    dt = 0.9
    end = start + dt
    ends = (cubic(start), cubic(end), slope(start), slope(end))
    theta = np.linspace(0.0, 1.0, 101)
    found = [hermite(float(one), *ends, dt) for one in theta]
    exact = cubic(start + theta * dt)
    return float(np.abs(found - exact).max())


# Theorem 4.2.1 and its constants.

# Steps of the theorem's table, s, and where in them the event lies.
THEOREM_STEPS = 0.5 / 2.0 ** np.arange(8)
PLACES = (0.1, 0.4, 0.5, 0.9)


def theorem_table() -> pd.DataFrame:
    """Measure localisation errors beside the theorem's bounds."""
    event = turning_point()
    rows = []
    for mesh in MESHES:
        for place in PLACES:
            for dt in THEOREM_STEPS:
                found = localise(event, float(dt), part=place, mesh=mesh)
                rows.append({"mesh": mesh, "place": place, **localised(found)})
    return pd.DataFrame(rows)


def localised(found: Localisation) -> dict[str, float]:
    """Return the errors and bounds of one event as columns."""
    return {
        "dt": found.dt,
        "time_error": found.time_error,
        "time_bound": found.time_bound,
        "state_error": found.state_error,
        "state_bound": found.state_bound,
    }


def theorem_row(table: pd.DataFrame) -> Row:
    """Compare errors with bounds, and their slopes with four (item 83)."""
    shares = table["time_error"] / table["time_bound"]
    state_shares = table["state_error"] / table["state_bound"]
    above = int((shares > 1.0).sum() + (state_shares > 1.0).sum())
    orders = [
        _slope(one, f"{what}_error")
        for _, one in table.groupby(["mesh", "place"])
        for what in ("time", "state")
    ]
    times, _ = octant_crossings()
    own = solve(octant(), T_SPAN, INITIAL_STATE, rtol=1e-12, atol=1e-14)
    values: dict[str, Any] = {
        "cases": 2 * len(table),
        "above": above,
        "least": min(orders),
        "most": max(orders),
        "share": float(max(shares.max(), state_shares.max())),
        "own_instants": float(np.abs(own.events.time - times).max()),
    }
    fourth = all(abs(order - EXPECTED_SLOPE) < SAME_ORDER for order in orders)
    if above == 0 and fourth:
        return Row(83, Agreement.AGREES, values, "covered")
    return Row(83, Agreement.DIFFERS, values, "broken")


def _slope(rows: pd.DataFrame, column: str) -> float:
    """Return the slope of an error over the step, both on logarithmic scales."""
    slope, _ = np.polyfit(np.log(rows["dt"]), np.log(rows[column]), 1)
    return float(slope)


def constants_row() -> Row:
    """Compute the constants of Table 4.1 on one step (item 84)."""
    found = localise(turning_point(), 0.1, mesh="dopri5")
    constants = found.constants
    values: dict[str, Any] = {
        "fourth": constants.fourth,
        "lipschitz": constants.lipschitz,
        "spline": constants.spline,
        "liveness": constants.liveness,
        "speed": constants.speed,
        "proven": constants.of_time,
        "measured": found.time_error / found.dt**4,
        "state_proven": constants.of_state,
        "state_measured": found.state_error / found.dt**4,
    }
    bounded = values["measured"] <= values["proven"]
    bounded = bounded and values["state_measured"] <= values["state_proven"]
    return Row(84, _built(bounded), values, "defined_twice")


def _built(holds: bool) -> Agreement:
    """Return that a definition is built, or that what is built is not what it says."""
    if holds:
        return Agreement.BUILT
    return Agreement.DIFFERS


# Figure 4.2.


def runs() -> dict[str, Run]:
    """Return the methods of the figure: printed, corrected, and hopdata's own two."""
    return {
        "printed": _printed(replace(AS_PRINTED, end="before")),
        "corrected": _printed(PrintedOptions()),
        "dopri5": _own("dopri5"),
        "dop853": _own("dop853"),
    }


def _printed(options: PrintedOptions) -> Run:
    """Return the printed method with equal steps of SciPy's DOPRI5."""
    from scipy.integrate import RK45

    region = region_of(octant())

    def run(longest: float, first: float) -> FloatArray:
        solver = equal_steps(RK45, longest, first)
        found = integrate(region, T_SPAN, INITIAL_STATE, solver=solver, options=options)
        return found.y_end

    return run


def _own(method: str) -> Run:
    """Return a method of `hopdata.hybrid.solve` with equal steps."""

    def run(longest: float, first: float) -> FloatArray:
        options: dict[str, Any] = dict(LOOSE)
        options["max_step"] = longest
        options["first_step"] = first
        found = solve(octant(), T_SPAN, INITIAL_STATE, method=method, **options)
        return found.y_end

    return run


@dataclass(frozen=True)
class Sweep:
    """Squared errors of final states, (seeds, steps, sweeps), over the longest step."""

    steps: FloatArray
    squares: FloatArray

    @property
    def rms(self) -> FloatArray:
        """RMS error at each step, over components and all sweeps, (steps,)."""
        return np.sqrt(self.squares.mean(axis=(0, 2)))

    @property
    def of_seeds(self) -> FloatArray:
        """RMS error at each step, by seed, (seeds, steps)."""
        return np.sqrt(self.squares.mean(axis=2))

    @property
    def single(self) -> FloatArray:
        """RMS error of each single sweep, over components alone, (sweeps, steps)."""
        by_sweep = np.moveaxis(self.squares, 1, 2)
        return np.sqrt(by_sweep.reshape(-1, len(self.steps)))


def swept(run: Run, seeds: Sequence[int], steps: FloatArray) -> Sweep:
    """Run a method at all steps, with first steps that each seed draws."""
    exact = octant_end()

    def of_seed(seed: int) -> FloatArray:
        rng = np.random.default_rng(np.random.SeedSequence(seed))
        # Evenly spread, from an offset that is drawn: the tail after an event is long
        # only if the event lies early in its step, so that few sweeps decide.
        shares = (np.arange(SWEEPS) + rng.random((len(steps), 1))) / SWEEPS
        squares = np.empty((len(steps), SWEEPS))
        for place, step in enumerate(steps):
            for sweep, share in enumerate(shares[place]):
                end = run(float(step), float(share * step))
                squares[place, sweep] = np.mean((end - exact) ** 2)
        return squares

    return Sweep(steps, np.array(over_seeds(of_seed, seeds)))


def shortest_piece() -> float:
    """Return the shortest time between events, or between an event and an end."""
    times, _ = octant_crossings()
    return float(np.diff([T_SPAN[0], *times, T_SPAN[1]]).min())


def error_table(sweeps: Mapping[str, Sweep]) -> pd.DataFrame:
    """Return error and fitted line by method and step."""
    tables = []
    for name, sweep in sweeps.items():
        fit = fit_order(sweep.steps, sweep.rms)
        limit = fit_limit(sweep.steps, sweep.rms, shortest_piece())
        columns = {
            "method": name,
            "step": sweep.steps,
            "error": sweep.rms,
            "in_fit": fit.used,
            "fitted": fit.error(sweep.steps),
            "slope": fit.order,
            "slope_se": fit.standard_error,
            "limit": limit.order,
            "limit_se": limit.standard_error,
        }
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)


def slope_table(sweep: Sweep) -> pd.DataFrame:
    """Return slopes over a decade of steps: of all sweeps together, and of single ones.

    Between ``low`` and ``high`` are nine of ten single sweeps, between ``least`` and
    ``most`` all. ``step`` is the decade's middle, ``longest`` its longest step.
    """
    rows = []
    for first in range(len(sweep.steps) - DECADE):
        part = slice(first, first + DECADE + 1)
        logs = np.log(sweep.steps[part])
        together, _ = np.polyfit(logs, np.log(sweep.rms[part]), 1)
        single, _ = np.polyfit(logs, np.log(sweep.single[:, part]).T, 1)
        low, high = np.quantile(single, [0.05, 0.95])
        row = {
            "step": float(np.exp(logs.mean())),
            "longest": float(sweep.steps[first]),
            "slope": float(together),
            "low": float(low),
            "high": float(high),
            "least": float(single.min()),
            "most": float(single.max()),
            "above_printed": float(np.mean(single >= PRINTED_SLOPE)),
        }
        rows.append(row)
    return pd.DataFrame(rows)


def figure_row(
    sweeps: Mapping[str, Sweep], errors: pd.DataFrame, slopes: pd.DataFrame
) -> Row:
    """Compare the slope of the printed method with the printed one (item 93)."""
    printed = sweeps["printed"]
    fit = fit_order(printed.steps, printed.rms)
    used = printed.steps[fit.used]
    if len(used) == 0:
        wanted = "a straight part of the error over the step"
        raise AnalysisError.at("figure 4.2", wanted, "none")
    logs = np.log(used)
    of_seeds, _ = np.polyfit(logs, np.log(printed.of_seeds[:, fit.used]).T, 1)
    limit = fit_limit(printed.steps, printed.rms, shortest_piece())
    # A decade whose steps are all shorter than the shortest piece has one event a step.
    apart = slopes[slopes["longest"] < shortest_piece()]
    own = errors.groupby("method")[["slope", "limit"]].first().to_dict("index")
    # The corrected method was run only in the longest of the steps.
    corrected = sweeps["corrected"].rms
    ratio = printed.rms[: len(corrected)] / corrected
    values: dict[str, Any] = {
        "slope": fit.order,
        "slope_se": fit.standard_error,
        "seeds": of_seeds.tolist(),
        "count": len(used),
        "shortest": float(used.min()),
        "longest": float(used.max()),
        "limit": limit.order,
        "limit_se": limit.standard_error,
        "limit_count": limit.n_steps,
        "sweep_least": float(apart["least"].min()),
        "sweep_most": float(apart["most"].max()),
        "above": 100.0 * float(apart["above_printed"].mean()),
        "ratio": float(ratio.max()),
        "dopri5": float(own["dopri5"]["limit"]),
        "dop853": float(own["dop853"]["slope"]),
    }
    agreement, reason = judged(values)
    return Row(93, agreement, values, reason)


def judged(values: Mapping[str, Any]) -> tuple[Agreement, str]:
    """Judge both printed claims: the slope, and that it shows third-order accuracy.

    The slope agrees if the printed one lies within three standard errors of the fitted
    one; the accuracy if four does, as far as an order can be told. If only a single
    sweep can have the printed slope, the claims agree in part.
    """
    margin = STANDARD_ERRORS * values["slope_se"]
    same = abs(values["slope"] - PRINTED_SLOPE) <= margin
    third = abs(values["slope"] - EXPECTED_SLOPE) <= max(margin, SAME_ORDER)
    possible = values["sweep_least"] <= PRINTED_SLOPE <= values["sweep_most"]
    if same and third:
        return Agreement.AGREES, "limit"
    if third and possible:
        return Agreement.PARTLY, "single"
    return Agreement.DIFFERS, "limit"
