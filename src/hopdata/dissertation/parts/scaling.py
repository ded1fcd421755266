"""The cost of a contact, by MuJoCo, the printed method and hopdata (section 4.4.4).

An infinite bar falls onto beds of 2 to 35 springs, from random starts at rest. The cost
of a contact is the slope of the median run time over the number of springs. The text
gives neither the bar's mass, the springs, nor the time; ours are those of
`hopdata.scenes.plate.Plate`, for 2 s. All solvers take turns in one thread, start by
start, so that their ratios hold, whatever the machine does.

Two things that the text leaves open decide the ratio, and both are measured:

- how MuJoCo's springs are made: as its contacts, or as balls on joints with springs,
  each of which brings a degree of freedom;
- how often a spring is touched: a bar that bounces meets each spring several times, and
  only the printed method pays for each time.

With steps of up to 1 s the printed method diverges at the first contacts, as on the
hopper. Here its steps are at most 20 ms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.dissertation.rows import Agreement, Made, Row
from hopdata.dissertation.turns import ON_PAR, on_par, timed
from hopdata.hybrid import solve
from hopdata.hybrid.printed import PrintedOptions, Stepping, integrate_both_ways
from hopdata.scenes.plate import Plate

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Run = Callable[[FloatArray], FloatArray]

# Numbers of springs (section 4.4.4).
CONTACTS = tuple(range(2, 36))
#: Simulated time.
#: Unit: s. Origin: chosen: as for the hopper of section 4.4.3.
UNTIL_S = 2.0
# MuJoCo's time step, as in Table 4.4, s.
TIMESTEP_S = 2e-3
#: Largest step of the printed method: its error is then below that of MuJoCo.
#: Unit: s. Origin: measured: tests/dissertation/test_scaling.py.
PRINTED_STEP_S = 0.02
#: Relative tolerance of `hopdata.hybrid.solve`.
#: Unit: 1. Origin: convention: its default.
RTOL = 1e-6
#: Relative tolerance of the ends that all others are compared with.
#: Unit: 1. Origin: chosen.
TIGHT = 1e-11
#: Random starts with each seed; the dissertation has 150.
#: Unit: 1. Origin: chosen: thirty starts of five seeds take most of a minute.
STARTS = 6
#: Numbers of springs of the bed on which the bar settles. Fewer make a bed that is
#: stiffer in tilt, whose steps are shorter.
#: Unit: 1. Origin: chosen.
SETTLING_CONTACTS = (5, 15, 25, 35)
#: Damping of the bed on which the bar settles, in place of 20 N s/m.
#: Unit: N s/m. Origin: derived: critical damping, 2 sqrt(k m).
SETTLING_DAMPING_N_S_M = 2.0 * np.sqrt(Plate().stiffness_n_m * Plate().mass_kg)
#: Neighbouring numbers of springs in a local slope.
#: Unit: 1. Origin: chosen.
WINDOW = 11
#: Bootstrap draws of the starts, for the band of a local slope.
#: Unit: 1. Origin: convention.
DRAWS = 500
#: Numbers of springs for which models are made and compared (section 1.3.6).
#: Unit: 1. Origin: chosen.
PROCEDURAL = (2, 35, 300)
#: Largest difference between a depth in MuJoCo and an event function, relative to the
#: depths: rounding, for a distance in MuJoCo's geometry.
#: Unit: m. Origin: rounding.
SAME_M = 1e-9
# A bar that presses down all springs: x, z, tilt, and rates.
PRESSED = (0.05, 0.6, 0.1, 0.0, 0.0, 0.0)


def make(seeds: Sequence[int]) -> Made:
    """Time all solvers for all numbers of springs; compare the slopes."""
    bouncing = raced(Plate, CONTACTS, seeds)
    settling = raced(settling_bed, SETTLING_CONTACTS, seeds)
    rows = [bar_row(), scaling_row(bouncing, settling, version("mujoco"))]
    tables = {
        "scaling": bouncing.table(),
        "marginal": bouncing.marginal(WINDOW),
        "settling": settling.marginal(2),
    }
    return Made(rows, tables)


def draw(tables: Mapping[str, pd.DataFrame]) -> Mapping[str, Figure]:
    """Draw Fig. 4.4."""
    from hopdata.dissertation.figures.scaling import scaling_figure

    figure = scaling_figure(tables["scaling"], tables["marginal"], tables["settling"])
    return {"fig4_4_scaling": figure}


def settling_bed(n_contacts: int) -> Plate:
    """Return the bar over a bed on which it comes to rest without bouncing."""
    return Plate(n_contacts, damping_n_s_m=SETTLING_DAMPING_N_S_M)


# The solvers, as functions from the start (6,) to the end (6,).


def solvers(plate: Plate) -> dict[str, Run]:
    """Return all solvers by name."""
    return {
        "MuJoCo": by_mujoco(plate, "contact"),
        "MuJoCo, sprung balls": by_mujoco(plate, "body"),
        "printed": by_printed(plate),
        "hopdata": by_hopdata(plate),
    }


def by_mujoco(plate: Plate, spring: str) -> Run:
    """Return MuJoCo with its default integrator, stepped in a Python loop."""
    from hopdata.dissertation.mujoco_models import Setting, plate_simulation

    simulation = plate_simulation(plate, Setting(spring, "Euler", TIMESTEP_S))
    count = round(UNTIL_S / TIMESTEP_S)

    def run(start: FloatArray) -> FloatArray:
        simulation.start(start)
        simulation.step_in_python(count)
        return simulation.state()

    return run


def by_printed(plate: Plate) -> Run:
    """Return the printed method around SciPy's DOPRI5, with its tolerances."""
    from scipy.integrate import RK45

    solver = Stepping(RK45, {"max_step": PRINTED_STEP_S})
    options = PrintedOptions(root_finder="cubic")

    def run(start: FloatArray) -> FloatArray:
        found = integrate_both_ways(
            plate.system(),
            (0.0, UNTIL_S),
            start,
            params=plate.params,
            solver=solver,
            options=options,
        )
        return found.y_end

    return run


def by_hopdata(plate: Plate, rtol: float = RTOL) -> Run:
    """Return `hopdata.hybrid.solve`."""

    def run(start: FloatArray) -> FloatArray:
        return solved(plate, start, rtol).y_end

    return run


def solved(plate: Plate, start: FloatArray, rtol: float) -> Any:
    """Return hopdata's solution, without output in between."""
    return solve(
        plate.system(),
        (0.0, UNTIL_S),
        start,
        params=plate.params,
        rtol=rtol,
        atol=0.1 * rtol,
        t_eval=(UNTIL_S,),
    )


# The race.


@dataclass(frozen=True)
class Race:
    """Run times of all solvers.

    Attributes
    ----------
    contacts : (C,) array
        Numbers of springs.
    times_us : dict of (K, S, C) arrays
        By solver, the run time per simulated second with each seed, start and number
        of springs, us/s.
    errors : dict of (K, S, C) arrays
        The largest deviation of the end, m, rad, and these per s.
    events : (K, S, C) array
        Touches and releases of springs.
    """

    contacts: FloatArray
    times_us: Mapping[str, FloatArray]
    errors: Mapping[str, FloatArray]
    events: FloatArray

    def slopes(self, solver: str) -> FloatArray:
        """Return the time per further contact with each seed, (K,), us/s."""
        medians = np.median(self.times_us[solver], axis=1)
        return slope(self.contacts, medians)

    def table(self) -> pd.DataFrame:
        """Return a row a solver and number of springs: times and errors."""
        import pandas as pd

        rows = []
        for solver, times in self.times_us.items():
            low, middle, high = np.percentile(times, (25, 50, 75), axis=(0, 1))
            columns = {
                "solver": solver,
                "n_contacts": self.contacts.astype(int),
                "time_q25_us": low,
                "time_median_us": middle,
                "time_q75_us": high,
                "error_median": np.median(self.errors[solver], axis=(0, 1)),
            }
            rows.append(pd.DataFrame(columns))
        return pd.concat(rows, ignore_index=True)

    def marginal(self, window: int) -> pd.DataFrame:
        """Return a row a solver and window: the slope and its 95 % band.

        A window has `window` neighbouring numbers of springs.
        """
        import pandas as pd

        rows = []
        for solver, times in self.times_us.items():
            starts = times.reshape(-1, len(self.contacts))
            medians = np.median(starts, axis=0)
            drawn = bootstrapped_medians(starts)
            for first in range(len(self.contacts) - window + 1):
                part = slice(first, first + window)
                counts = self.contacts[part]
                of_draws = slope(counts, drawn[:, part])
                low, high = np.percentile(of_draws, (2.5, 97.5))
                row = {
                    "solver": solver,
                    "n_contacts": float(counts.mean()),
                    "low95_us": low,
                    "marginal_us": float(slope(counts, medians[part])),
                    "high95_us": high,
                }
                rows.append(row)
        return pd.DataFrame(rows)


def raced(
    bed: Callable[[int], Plate], contacts: Sequence[int], seeds: Sequence[int]
) -> Race:
    """Run all solvers from the starts of all seeds, one start after the other."""
    plates = [bed(n) for n in contacts]
    runs = [solvers(plate) for plate in plates]
    exact = [by_hopdata(plate, TIGHT) for plate in plates]
    # The starts are the same for all numbers of springs.
    starts = [plates[0].initial_states(STARTS, seed) for seed in seeds]
    warmed_up(runs, starts[0][0])
    shape = (len(seeds), STARTS, len(contacts))
    times = {name: np.empty(shape) for name in runs[0]}
    errors = {name: np.empty(shape) for name in runs[0]}
    events = np.empty(shape)
    for k, s, c in np.ndindex(shape):
        start = starts[k][s]
        true_end = exact[c](start)
        events[k, s, c] = len(solved(plates[c], start, RTOL).events)
        for name, run in runs[c].items():
            seconds, end = timed(partial(run, start))
            times[name][k, s, c] = 1e6 * seconds / UNTIL_S
            errors[name][k, s, c] = np.abs(end - true_end).max()
    return Race(np.array(contacts, dtype=float), times, errors, events)


def warmed_up(runs: Sequence[Mapping[str, Run]], start: FloatArray) -> None:
    """Run all once, so that no time includes a compilation."""
    for of_bed in runs:
        for run in of_bed.values():
            run(start)


def slope(counts: FloatArray, times: FloatArray) -> FloatArray:
    """Return the slopes, (...,), of times (..., C) over the numbers, (C,)."""
    centred = counts - counts.mean()
    return np.asarray(times @ centred / (centred @ centred))


def bootstrapped_medians(starts: FloatArray) -> FloatArray:
    """Return the medians, (D, C), of starts (S, C) that are drawn with replacement."""
    rng = np.random.default_rng(0)
    drawn = rng.integers(0, len(starts), (DRAWS, len(starts)))
    return np.array([np.median(starts[draw], axis=0) for draw in drawn])


# The rows.

# Names of solvers in the rows.
NAMES = {
    "mujoco": "MuJoCo",
    "balls": "MuJoCo, sprung balls",
    "printed": "printed",
    "hopdata": "hopdata",
}


def scaling_row(bouncing: Race, settling: Race, mujoco_version: str) -> Row:
    """Return Fig. 4.4: time per contact of each solver, and their ratios.

    The printed method should cost as much as MuJoCo, on either bed, and a compiled
    integrator less.
    """
    costs = {short: bouncing.slopes(name) for short, name in NAMES.items()}
    settled = {short: settling.slopes(name) for short, name in NAMES.items()}
    lists = {f"{short}_us": cost for short, cost in costs.items()}
    lists["printed_ratio"] = costs["printed"] / costs["mujoco"]
    lists["balls_ratio"] = costs["printed"] / costs["balls"]
    lists["settling_ratio"] = settled["printed"] / settled["mujoco"]
    lists["settling_balls_ratio"] = settled["printed"] / settled["balls"]
    lists["hopdata_times_faster"] = costs["mujoco"] / costs["hopdata"]
    values: dict[str, Any] = {name: one.tolist() for name, one in lists.items()}
    for short, name in NAMES.items():
        values[f"{short}_error"] = float(np.median(bouncing.errors[name]))
    # Of a spring, each time.
    values["events"] = float(np.median(bouncing.events / bouncing.contacts))
    values["settling_events"] = float(np.median(settling.events / settling.contacts))
    values["settling_error"] = float(np.median(settling.errors["printed"]))
    values["starts"] = STARTS
    values["mujoco"] = mujoco_version
    values["on_par"] = ON_PAR
    values["step_ms"] = 1e3 * PRINTED_STEP_S
    held = [
        on_par(float(np.median(values["printed_ratio"]))),
        on_par(float(np.median(values["settling_ratio"]))),
        float(np.median(values["hopdata_times_faster"])) > 1.0,
    ]
    if all(held):
        return Row(97, Agreement.AGREES, values)
    if any(held):
        return Row(97, Agreement.PARTLY, values, "events")
    return Row(97, Agreement.DIFFERS, values, "events")


def bar_row() -> Row:
    """Return whether any bed can be generated, and MuJoCo's depths are the h_i."""
    deviations = [largest_deviation(Plate(n)) for n in PROCEDURAL]
    most = PROCEDURAL[-1]
    start = np.array([0.0, 2.4, 0.06, 0.0, 0.0, 0.0])
    touched = solved(Plate(most), start, RTOL).events.guard
    values = {
        "fewest": PROCEDURAL[0],
        "most": most,
        "deviation_m": max(deviations),
        "touched": len(np.unique(touched)),
    }
    if values["deviation_m"] < SAME_M and values["touched"] == most:
        return Row(13, Agreement.BUILT, values)
    return Row(13, Agreement.DIFFERS, values)


def largest_deviation(plate: Plate) -> float:
    """Return how far MuJoCo's depths are from the event functions, m.

    It is infinite if MuJoCo does not have a contact at each spring.
    """
    from hopdata.dissertation.mujoco_models import Setting, depths, plate_simulation

    simulation = plate_simulation(plate, Setting("contact", "Euler", TIMESTEP_S))
    found = depths(simulation, PRESSED) / np.cos(PRESSED[2])
    wanted = plate.compressions(PRESSED)
    if len(found) != len(wanted):
        return float("inf")
    return float(np.abs(np.sort(found) - np.sort(wanted)).max())
