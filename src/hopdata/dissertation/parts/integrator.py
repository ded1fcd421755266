"""Chapter IV, the integrator: Algorithms 5 to 7, to the letter and corrected.

What the text has wrong is shown where it fails: each algorithm runs as printed
(`hopdata.hybrid.printed.AS_PRINTED`) and corrected, against exact solutions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.dissertation.rows import Agreement, Made, Row, over_seeds
from hopdata.hybrid import solve
from hopdata.hybrid.printed import (
    AS_PRINTED,
    FixedSteps,
    Ivp,
    PrintedOptions,
    PrintedSolution,
    Region,
    Stepping,
    closed_form,
    coefficients,
    hermite,
    illinois,
    illinois_root,
    integrate,
    integrate_alternating,
    integrate_both_ways,
    region_of,
    resolve_contacts,
    rk4_step,
)
from hopdata.hybrid.printed.order import equal_steps
from hopdata.hybrid.printed.spline import Cubic, value
from hopdata.scenes.octant import (
    INITIAL_STATE,
    T_SPAN,
    octant,
    octant_crossings,
    octant_end,
)
from hopdata.scenes.plate import Plate
from hopdata.scenes.vertical_hopper import VerticalHopper, hopper_end

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# To the letter, but for the loop that does not end: so it can be measured.
PRINTED = replace(AS_PRINTED, end="before")
CORRECTED = PrintedOptions()
RESTARTED = PrintedOptions(tail="restart")

# The drop of section 4.4.3: from rest at 2 m, for 2 s.
DROP_M = 2.0
UNTIL_S = 2.0

#: Factor between two errors above which one method is worse than the other.
#: Unit: 1. Origin: chosen.
WORSE = 2.0
#: Largest distance of numbers that differ by rounding.
#: Unit: 1. Origin: chosen: some thousand roundings.
ROUNDING = 1e-12


def make(seeds: Sequence[int]) -> Made:
    """Measure the items 85 to 92 and 98."""
    step = drawn_step()
    rows = [
        locking_row(),
        resolution_row(),
        impact_row(seeds),
        alternation_row(seeds),
        wrapper_row(),
        drawing_row(step),
        hopper_row(),
        octant_row(),
        plate_row(seeds),
    ]
    return Made(rows, {"step": step})


def draw(tables: Mapping[str, pd.DataFrame]) -> Mapping[str, Figure]:
    """Draw Figure 4.1."""
    from hopdata.dissertation.figures.integrator import step_figure

    return {"fig4_1_step": step_figure(tables["step"])}


def error(found: FloatArray, exact: FloatArray) -> float:
    """Return the largest deviation of a state."""
    return float(np.abs(found - exact).max())


def dopri5(longest: float) -> Stepping:
    """Return the classical solver of section 4.4.1 with its error control."""
    from scipy.integrate import RK45

    return Stepping(RK45, {"rtol": 1e-9, "atol": 1e-12, "max_step": longest})


def fixed(length: float) -> Stepping:
    """Return the same with steps of one length."""
    from scipy.integrate import RK45

    return equal_steps(RK45, length)


def on_octant(
    solver: Any, options: PrintedOptions, start: Sequence[float] = INITIAL_STATE
) -> PrintedSolution:
    """Run the printed method on Table 4.3."""
    region = region_of(octant())
    return integrate(region, T_SPAN, start, solver=solver, options=options)


# Locks (item 85).

#: Runs with different steps in which each guard should be crossed once.
#: Unit: 1. Origin: chosen.
LOCKED_RUNS = 100
# A start on the plane y = 0, which is crossed upwards at once.
ON_PLANE = (-0.4, 0.0, 0.3)


def locking_row() -> Row:
    """Count crossings with locks; start on a guard, with locks as printed and kept."""
    lengths = np.geomspace(0.3, 0.003, LOCKED_RUNS)
    once = 0
    for length in lengths:
        log = on_octant(fixed(float(length)), CORRECTED).events
        once += sorted(log.guard.tolist()) == [0, 1, 2]
    exact = solve(octant(), T_SPAN, ON_PLANE, rtol=1e-13, atol=1e-15).y_end
    solver = fixed(0.005)
    values: dict[str, Any] = {
        "runs": LOCKED_RUNS,
        "once": once,
        "printed": error(on_octant(solver, PRINTED, ON_PLANE).y_end, exact),
        "kept": error(on_octant(solver, CORRECTED, ON_PLANE).y_end, exact),
    }
    if once < LOCKED_RUNS:
        return Row(85, Agreement.DIFFERS, values, "sticking")
    if values["printed"] > WORSE * values["kept"]:
        return Row(85, Agreement.PARTLY, values, "zero")
    return Row(85, Agreement.AGREES, values)


# Algorithm 5 (item 86).


def resolution_row() -> Row:
    """Resolve the three events of Table 4.3 within one step (item 86)."""
    exact = octant_end()
    whole = fixed(T_SPAN[1])
    printed = on_octant(whole, PRINTED)
    corrected = on_octant(whole, CORRECTED)
    own = solve(octant(), T_SPAN, INITIAL_STATE, method="dopri5")
    values: dict[str, Any] = {
        "printed": error(printed.y_end, exact),
        "corrected": error(corrected.y_end, exact),
        "own": error(own.y_end, exact),
        "events": len(printed.events),
        "apart_printed": error(on_octant(fixed(0.02), PRINTED).y_end, exact),
        "apart_corrected": error(on_octant(fixed(0.02), CORRECTED).y_end, exact),
    }
    values["factor"] = values["printed"] / values["corrected"]
    if values["events"] != 3:
        return Row(86, Agreement.DIFFERS, values, "lost")
    if values["factor"] > WORSE:
        return Row(86, Agreement.PARTLY, values, "slopes")
    return Row(86, Agreement.BUILT, values)


# Algorithm 6 (item 87).

#: Random splines of each seed, on which both root finders are compared.
#: Unit: 1. Origin: chosen.
N_SPLINES = 400
#: Landings of a level plate with each seed.
#: Unit: 1. Origin: chosen.
N_LANDINGS = 8


def impact_row(seeds: Sequence[int]) -> Row:
    """Compare the root finders; land level plates, whose springs touch together."""
    found = over_seeds(_roots_of, seeds)
    refused = over_seeds(_level_landings, seeds)
    values: dict[str, Any] = {
        "splines": N_SPLINES,
        "difference": [one[0] for one in found],
        "evaluations": [one[1] for one in found],
        "landings": N_LANDINGS,
        "refused": [one[0] for one in refused],
        "corrected": [one[1] for one in refused],
    }
    if max(values["difference"]) > ROUNDING:
        return Row(87, Agreement.DIFFERS, values, "roots")
    if max(values["refused"]) > 0:
        return Row(87, Agreement.PARTLY, values, "bracket")
    return Row(87, Agreement.BUILT, values)


def _roots_of(seed: int) -> tuple[float, float]:
    """Return the largest difference of both finders, and evaluations of Illinois."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    largest = 0.0
    calls = 0
    for _ in range(N_SPLINES):
        # Rising splines: both slopes are up to three times the chord's, which keeps a
        # Hermite cubic monotone, so that there is one root.
        low = -rng.uniform(0.01, 1.0)
        high = rng.uniform(0.01, 1.0)
        slopes = rng.uniform(0.1, 2.0, 2) * (high - low)
        cubic = coefficients(low, high, float(slopes[0]), float(slopes[1]))
        largest = max(largest, abs(illinois(cubic) - closed_form(cubic)))
        calls += _evaluations(cubic)
    return largest, calls / N_SPLINES


def _evaluations(cubic: Cubic) -> int:
    """Return how often the Illinois method evaluates a cubic."""
    calls = []

    def counted(x: float) -> float:
        calls.append(x)
        return value(cubic, x)

    illinois_root(counted, 0.0, 1.0)
    return len(calls)


def _level_landings(seed: int) -> tuple[int, int]:
    """Return how many level plates lack a bracket, as printed and corrected."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    plate = Plate(7)
    as_printed = replace(CORRECTED, cross_at_surface=False)
    refused = 0
    corrected = 0
    for height in rng.uniform(2.0, 3.0, N_LANDINGS):
        start = (rng.uniform(-0.5, 0.5), height, 0.0, 0.0, 0.0, 0.0)
        refused += _has_no_bracket(plate, start, as_printed)
        corrected += _has_no_bracket(plate, start, CORRECTED)
    return refused, corrected


def _has_no_bracket(
    plate: Plate, start: Sequence[float], options: PrintedOptions
) -> bool:
    """Return whether the printed method finds no bracket of a root, and gives up."""
    region = region_of(plate.system(), plate.params)
    try:
        integrate(region, (0.0, 0.7), start, solver=dopri5(0.02), options=options)
    except ArithmeticError:
        return True
    return False


# Algorithm 7 (item 88) and the hopper of section 4.3.4 (item 91).


def hopper_regions(hopper: VerticalHopper) -> tuple[Region, Region]:
    """Return the region of touchdown, and the one of take-off."""
    system = hopper.system()
    falling = region_of(system, hopper.params, orientation=(-1,))
    rising = region_of(system, hopper.params, orientation=(1,))
    return falling, rising


def hops(
    solver: Any,
    options: PrintedOptions,
    start: Sequence[float] = (DROP_M, 0.0),
    until_s: float = UNTIL_S,
) -> PrintedSolution:
    """Run Algorithm 7 on the hopper."""
    regions = hopper_regions(VerticalHopper())
    span = (0.0, until_s)
    return integrate_alternating(*regions, span, start, solver=solver, options=options)


#: Length of a step that holds the apex and the touchdown of a low hop.
#: Unit: s. Origin: chosen.
LONG_STEP_S = 0.12
#: Largest error of the hopper's end with which Algorithm 7 is right once it ends.
#: Unit: m, m/s. Origin: chosen: far above that of steps of 2 ms, far below a hop.
RIGHT = 1e-3
#: Low hops of each seed.
#: Unit: 1. Origin: chosen.
N_LOW_HOPS = 20


def alternation_row(seeds: Sequence[int]) -> Row:
    """Run Algorithm 7 to its end, from rest, and with steps over apex and touchdown."""
    exact = hopper_end(VerticalHopper(), DROP_M, UNTIL_S)
    lost = over_seeds(_lost_touchdowns, seeds)
    values: dict[str, Any] = {
        "ends": _ends(AS_PRINTED),
        "corrected_ends": _ends(CORRECTED),
        "hops": N_LOW_HOPS,
        "rest_printed": _touchdowns_from_rest("rising"),
        "rest": _touchdowns_from_rest("acceleration"),
        "lost": [one[0] for one in lost],
        "corrected_lost": [one[1] for one in lost],
        "printed": error(hops(dopri5(0.002), PRINTED).y_end, exact),
        "corrected": error(hops(dopri5(0.002), CORRECTED).y_end, exact),
    }
    if values["printed"] > RIGHT:
        return Row(88, Agreement.DIFFERS, values, "loop")
    if not values["ends"]:
        # With the slip mended and short steps it is right.
        return Row(88, Agreement.PARTLY, values, "loop")
    return Row(88, Agreement.BUILT, values)


def _ends(options: PrintedOptions) -> bool:
    """Return whether Algorithm 7 comes to its end on the hopper."""
    try:
        hops(dopri5(0.05), options)
    except ArithmeticError:
        return False
    return True


def _touchdowns_from_rest(rest: str) -> int:
    """Return the touchdowns of a drop that falls to the floor within the first step."""
    options = PrintedOptions(tail="restart", boundary="mesh", rest=rest)
    found = hops(fixed(0.6), options, until_s=0.6)
    return len(found.events.of("contact", direction=-1))


def _lost_touchdowns(seed: int) -> tuple[int, int]:
    """Return how many low hops lack their touchdown, as printed and corrected."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    hopper = VerticalHopper()
    counts = [0, 0]
    for speed in rng.uniform(0.2, 0.45, N_LOW_HOPS):
        # It has just left the floor, and is back at the floor within one step.
        start = (hopper.contact_length_m + 1e-3, speed)
        for place, boundary in enumerate(("mesh", "localised")):
            options = PrintedOptions(tail="restart", boundary=boundary)
            found = hops(fixed(LONG_STEP_S), options, start, LONG_STEP_S)
            counts[place] += len(found.events.of("contact", direction=-1)) == 0
    return counts[0], counts[1]


def hopper_row() -> Row:
    """Compare ends of the hopper with its closed form (item 91)."""
    hopper = VerticalHopper()
    exact = hopper_end(hopper, DROP_M, UNTIL_S)
    own = solve(hopper.system(), (0.0, UNTIL_S), (DROP_M, 0.0), params=hopper.params)
    short, long = dopri5(0.002), dopri5(1.0)
    values: dict[str, Any] = {
        "printed": error(hops(short, PRINTED).y_end, exact),
        "printed_long": error(hops(long, PRINTED).y_end, exact),
        "corrected": error(hops(short, CORRECTED).y_end, exact),
        "restarted_long": error(hops(long, RESTARTED).y_end, exact),
        "events": len(hops(short, PRINTED).events),
        "own": error(own.y_end, exact),
        "own_events": own.n_events,
    }
    if values["events"] != values["own_events"]:
        return Row(91, Agreement.DIFFERS, values, "events")
    if values["printed_long"] > 1.0:
        return Row(91, Agreement.PARTLY, values, "tail")
    return Row(91, Agreement.AGREES, values)


# The wrapper (item 89, contribution 1.3.5).


def wrapped() -> dict[str, Any]:
    """Return classical solvers of several makes, all with steps of at most 0.002."""
    from scipy.integrate import DOP853, LSODA, RK45, Radau

    options = {"rtol": 1e-9, "atol": 1e-12, "max_step": 0.002}
    return {
        "RK45": Stepping(RK45, options),
        "DOP853": Stepping(DOP853, options),
        "Radau": Stepping(Radau, options),
        "LSODA": Stepping(LSODA, options),
        "solve_ivp": Ivp(options),
        "RK4": FixedSteps(rk4_step, 0.002),
    }


def wrapper_row() -> Row:
    """Wrap six solvers on Table 4.3."""
    exact = octant_end()
    errors = {}
    right = 0
    for name, solver in wrapped().items():
        found = on_octant(solver, CORRECTED)
        errors[name] = error(found.y_end, exact)
        right += found.events.guard.tolist() == [1, 2, 0]
    values: dict[str, Any] = {
        "solvers": len(errors),
        "right": right,
        "stepping": max(errors[name] for name in ("RK45", "DOP853", "Radau", "LSODA")),
        "solve_ivp": errors["solve_ivp"],
        "own_rk4": errors["RK4"],
    }
    if right == len(errors):
        return Row(89, Agreement.AGREES, values, "forms")
    return Row(89, Agreement.DIFFERS, values, "lost")


# Figure 4.1 (item 90).

# The drawn step, around the first event of Table 4.3.
DRAWN = (0.05, 0.45)
N_DRAWN = 121


def drawn_step() -> pd.DataFrame:
    """Return the event function of a step with an event, over time.

    Returns
    -------
    DataFrame
        ``time``; ``locked``: h along the exact flow with the locks held, on to the end;
        ``true``: h along the exact flow, which changes at the event; ``spline``: p_h;
        and, the same in all rows, ``instant`` (t*) and ``root`` (t').
    """
    region = region_of(octant())
    before = -np.ones(3, dtype=np.int64)
    exact = solve(
        octant(), (0.0, DRAWN[1]), INITIAL_STATE, dense_output=True, rtol=1e-12
    )
    t0, t1 = DRAWN
    y0 = exact(t0)
    instants, _ = octant_crossings()
    # The flow has a corner at the event, which is enlarged in the figure.
    near = instants[0] + np.linspace(-1e-3, 1e-3, 5)
    times = np.union1d(np.linspace(t0, t1, N_DRAWN), near)
    locked = _locked_states(region, y0, times)
    y1 = locked[-1]
    h, rates = zip(
        *(region.events(t, y, region.slope(t, y, before), before)
          for t, y in ((t0, y0), (t1, y1))),
        strict=True,
    )  # fmt: skip
    k = octant().guard_names.index("y")
    ends = h[0][k], h[1][k], rates[0][k], rates[1][k]
    spline = [hermite(float((t - t0) / (t1 - t0)), *ends, t1 - t0) for t in times]
    resolved = resolve_contacts(region, t0, y0, t1, y1, before, CORRECTED)
    crossing = next(one for one in resolved.crossings if one.guard == k)
    return pd.DataFrame(
        {
            "time": times,
            "locked": locked[:, k],
            "true": exact(times)[k],
            "spline": spline,
            "instant": instants[0],
            "root": crossing.time,
        }
    )


def _locked_states(region: Region, y0: FloatArray, times: FloatArray) -> FloatArray:
    """Return the states (N, 3) of the flow that never leaves the mode of its start."""
    from scipy.integrate import solve_ivp

    before = -np.ones(3, dtype=np.int64)
    span = (times[0], times[-1])
    options = {"t_eval": times, "method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    return solve_ivp(region.slope_in(before), span, y0, **options).y.T


def drawing_row(step: pd.DataFrame) -> Row:
    """Compare the root of the drawn spline with the event (item 90)."""
    instant, root = float(step["instant"].iloc[0]), float(step["root"].iloc[0])
    spread = float(np.abs(step["spline"] - step["locked"]).max())
    before = step["time"] <= instant
    same = error(step["locked"][before].to_numpy(), step["true"][before].to_numpy())
    values: dict[str, Any] = {
        "length": DRAWN[1] - DRAWN[0],
        "instant": instant,
        "wrong": abs(root - instant),
        "spread": spread,
        "same": same,
    }
    if same < 1e-9 and values["wrong"] < 0.01 * values["length"]:
        return Row(90, Agreement.AGREES, values)
    return Row(90, Agreement.DIFFERS, values, "apart")


# Table 4.3 (item 92).


def octant_row() -> Row:
    """Integrate Table 4.3 as printed, and compare with its exact solution."""
    times, _ = octant_crossings()
    exact = octant_end()
    printed = on_octant(dopri5(0.01), PRINTED)
    own = solve(octant(), T_SPAN, INITIAL_STATE, rtol=1e-9, atol=1e-12)
    values: dict[str, Any] = {
        "y": times[0],
        "z": times[1],
        "x": times[2],
        "end_x": exact[0],
        "end_y": exact[1],
        "end_z": exact[2],
        "events": len(printed.events),
        "printed": error(printed.y_end, exact),
        "instants": error(printed.events.time, times),
        "own": error(own.y_end, exact),
    }
    crossed = sorted(printed.events.guard.tolist()) == [0, 1, 2]
    inside = T_SPAN[0] < times.min() and times.max() < T_SPAN[1]
    if crossed and inside:
        return Row(92, Agreement.AGREES, values, "direction")
    return Row(92, Agreement.DIFFERS, values, "direction")


# The plate (item 98).

#: Starts of the plate that are drawn.
#: Unit: 1. Origin: convention: section 4.4.4 of the dissertation.
N_STARTS = 150
#: Springs of the plate that is dropped, the most of section 4.4.4.
#: Unit: 1. Origin: convention: section 4.4.4 of the dissertation.
MOST_SPRINGS = 35
# Longest step, s, of the printed method here. With the dissertation's, 1 s, the tail
# after the first contact has no bound.
PLATE_STEP_S = 0.01


def plate_row(seeds: Sequence[int]) -> Row:
    """Compare gradients, draw the starts, and drop a plate of each seed (item 98)."""
    plate = Plate(MOST_SPRINGS)
    found = over_seeds(_dropped, seeds)
    starts = [plate.initial_states(N_STARTS, seed) for seed in seeds]
    together = np.concatenate(starts)
    above = plate.compressions(together.T) < 0.0
    values: dict[str, Any] = {
        "starts": N_STARTS,
        "springs": MOST_SPRINGS,
        "z_least": float(together[:, 1].min()),
        "z_most": float(together[:, 1].max()),
        "angle_least": float(together[:, 2].min()),
        "angle_most": float(together[:, 2].max()),
        "above": 100.0 * float(above.all(axis=0).mean()),
        "gradient": gradient_error(plate),
        "printed": [one[0] for one in found],
        "own": [one[1] for one in found],
        "lost": [one[2] for one in found],
        "contacts": [one[3] for one in found],
    }
    drawn = values["z_least"] > 2.0 and values["z_most"] < 3.0
    drawn = drawn and values["angle_least"] > -0.1 and values["angle_most"] < 0.1
    if drawn and above.all() and values["gradient"] < 1e-8 and max(values["lost"]) == 0:
        return Row(98, Agreement.BUILT, values, "partition")
    return Row(98, Agreement.DIFFERS, values, "partition")


def gradient_error(plate: Plate) -> float:
    """Return the largest deviation of Dh_i from differences of h_i, over some poses."""
    largest = 0.0
    step = 1e-6
    for x, z, angle in ((0.0, 2.5, 0.05), (0.3, 0.9, -0.4), (-0.7, 1.1, 0.8)):
        state = np.array([x, z, angle, 0.0, 0.0, 0.0])
        columns = []
        for axis in range(3):
            nudge = np.zeros(6)
            nudge[axis] = step
            rise = plate.compressions(state + nudge) - plate.compressions(state - nudge)
            columns.append(rise / (2.0 * step))
        largest = max(largest, error(plate.gradients(state), np.array(columns).T))
    return largest


def _dropped(seed: int) -> tuple[float, float, int, int]:
    """Drop a plate; return both errors, how many events are lost, and of how many."""
    plate = Plate(MOST_SPRINGS)
    start = plate.initial_states(1, seed)[0]
    span = (0.0, UNTIL_S)
    system, params = plate.system(), plate.params
    exact = solve(system, span, start, params=params, rtol=1e-12, atol=1e-13)
    own = solve(system, span, start, params=params)
    printed = integrate_both_ways(
        system, span, start, params=params, solver=dopri5(PLATE_STEP_S)
    )
    lost = exact.n_events - len(printed.events)
    errors = error(printed.y_end, exact.y_end), error(own.y_end, exact.y_end)
    return *errors, lost, exact.n_events
