"""The hopper in MuJoCo, by the printed method and by hopdata (section 4.4.3).

The undamped hopper is dropped from rest at 2 m and simulated for 2 s; its motion has a
closed form. The text gives neither mass nor stiffness, tolerance, nor MuJoCo's kind of
contact: k / m is 1000 per s^2, and MuJoCo has its default contact and integrator with
the stiffness of the hopper. All solvers take turns in one thread, so that their ratios
hold, whatever the machine does.

The printed method runs in three forms, all with steps of at most 1 s:

- "printed": to the letter (`AS_PRINTED`), except that it ends, with SciPy's tolerance;
- "restarted": the classical solver starts anew at each contact, with its own error
  control, in place of one step of third order to the end of the printed step;
- "restarted, tight": the same with a tolerance of 1e-6.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.dissertation.rows import Agreement, Made, Row, over_seeds
from hopdata.dissertation.turns import ON_PAR, in_turn, on_par
from hopdata.hybrid import solve
from hopdata.hybrid.printed import (
    AS_PRINTED,
    PrintedOptions,
    PrintedSolution,
    Stepping,
    integrate_alternating,
    region_of,
)
from hopdata.scenes.vertical_hopper import VerticalHopper, hopper_states

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from hopdata.dissertation.mujoco_models import Simulation

HOPPER = VerticalHopper()
# The drop of section 4.4.3, m and m/s, and its time, s.
START = (2.0, 0.0)
UNTIL_S = 2.0
# SciPy's relative tolerance where none is given.
SCIPY_RTOL = 1e-3
# MuJoCo's time step, and the largest step of the printed method (Table 4.4), s.
TIMESTEP_S = 2e-3
PRINTED_STEP_S = 1.0
#: Relative tolerance of `hopdata.hybrid.solve`.
#: Unit: 1. Origin: chosen. The affine modes of the hopper are exact at any tolerance.
RTOL = 1e-9
#: Largest step of the printed method where its energy is followed: at this step its
#: error is far below that of MuJoCo.
#: Unit: s. Origin: measured: tests/dissertation/test_calibration.py.
FOLLOWED_STEP_S = 1e-2
#: Relative tolerance of the classical solver in the form that is called tight; the
#: absolute one is a thousandth of it, as in SciPy.
#: Unit: 1. Origin: chosen.
TIGHT = 1e-6
#: Time for which MuJoCo's hopper hops to see whether it gains energy.
#: Unit: s. Origin: chosen: some nine hops.
HOPPING_S = 10.0
#: Turns in which all solvers run once, for each seed.
#: Unit: 1. Origin: chosen.
TURNS = 21
#: Consecutive calls of `solve` in each turn, since one takes microseconds.
#: Unit: 1. Origin: chosen.
CALLS = 20
#: Half the range of heights, about 2 m, from which the hopper is dropped to see whether
#: it gains energy.
#: Unit: m. Origin: chosen. Contacts fall anywhere within a time step.
RANGE_M = 0.1
#: Number of these drops with each seed.
#: Unit: 1. Origin: chosen.
DROPS = 20
#: Share of hops that must gain energy for "each hop gains energy" to hold.
#: Unit: 1. Origin: convention: 95 %.
NEARLY_ALL = 0.95
#: How many times larger the energy's error must be in steps with a contact than in
#: others for the check of energy to have found where it arises.
#: Unit: 1. Origin: chosen: an order of magnitude.
CLEARLY = 10.0
#: Largest relative change of energy that is rounding.
#: Unit: 1. Origin: chosen.
ROUNDING = 1e-12

LETTER = replace(AS_PRINTED, end="before")
RESTARTED = PrintedOptions(root_finder="cubic", tail="restart")


@dataclass(frozen=True)
class Trajectory:
    """Height and velocity of the hopper by one solver.

    Attributes
    ----------
    solver : str
        Name of the solver.
    time_s : (N,) array
        Times of its mesh, s.
    states : (2, N) array
        Heights, m, and velocities, m/s.
    """

    solver: str
    time_s: FloatArray
    states: FloatArray

    @property
    def residuals(self) -> FloatArray:
        """Deviations from the closed form, (2, N), m and m/s."""
        return self.states - hopper_states(HOPPER, START[0], self.time_s)

    @property
    def largest(self) -> FloatArray:
        """Largest sizes of the deviations, (2,), m and m/s."""
        return np.asarray(np.abs(self.residuals).max(axis=1))

    @property
    def energy(self) -> FloatArray:
        """Energy relative to that of the start, less 1, (N,)."""
        return np.asarray(HOPPER.energy(self.states) / HOPPER.energy(START) - 1.0)

    def table(self) -> pd.DataFrame:
        """Return a row an instant: states and residuals."""
        import pandas as pd

        residuals = self.residuals
        columns = {
            "solver": self.solver,
            "time_s": self.time_s,
            "height_m": self.states[0],
            "velocity_m_s": self.states[1],
            "height_residual_m": residuals[0],
            "velocity_residual_m_s": residuals[1],
        }
        return pd.DataFrame(columns)


def make(seeds: Sequence[int]) -> Made:
    """Race the three solvers on the hopper; compare their paths and their energies."""
    import pandas as pd

    found = {one.solver: one for one in trajectories()}
    races = over_seeds(race, seeds)
    rows = [
        energy_row(found["hopdata"]),
        table_row(found, races, version("mujoco")),
        figure_row(found),
        gain_row(found, seeds),
    ]
    exact = Trajectory("exact", GRID_S, hopper_states(HOPPER, START[0], GRID_S))
    shown = [exact, *(found[name] for name in SHOWN)]
    table = pd.concat([one.table() for one in shown], ignore_index=True)
    return Made(rows, {"calibration_trajectories": table})


def draw(tables: Mapping[str, pd.DataFrame]) -> Mapping[str, Figure]:
    """Draw Fig. 4.3."""
    from hopdata.dissertation.figures.calibration import calibration_figure

    return {
        "fig4_3_calibration": calibration_figure(tables["calibration_trajectories"])
    }


# The solvers.

N_STEPS = round(UNTIL_S / TIMESTEP_S)
# Times at which MuJoCo and hopdata are compared with the closed form, s.
GRID_S: FloatArray = TIMESTEP_S * np.arange(N_STEPS + 1, dtype=np.float64)
# Trajectories that the figure shows beside the exact one.
SHOWN = ("MuJoCo", "printed", "restarted, tight", "hopdata")


def trajectories() -> list[Trajectory]:
    """Return the trajectory of each solver, and of MuJoCo's most exact contact."""
    return [
        by_mujoco("MuJoCo", "default contact"),
        by_mujoco("MuJoCo, constant impedance", "contact"),
        by_printed("printed", printed_solver(LETTER)),
        by_printed("restarted", printed_solver(RESTARTED)),
        by_printed("restarted, tight", printed_solver(RESTARTED, rtol=TIGHT)),
        by_hopdata(),
    ]


def mujoco_hopper(spring: str = "default contact") -> Simulation:
    """Return the hopper in MuJoCo, with its default integrator."""
    from hopdata.dissertation.mujoco_models import Setting, hopper_simulation

    return hopper_simulation(HOPPER, Setting(spring, "Euler", TIMESTEP_S))


def by_mujoco(name: str, spring: str) -> Trajectory:
    """Return the trajectory by MuJoCo, at all of its steps."""
    states = mujoco_hopper(spring).roll_out(START, N_STEPS)
    return Trajectory(name, GRID_S, np.column_stack([START, states]))


def by_printed(name: str, solver: Callable[[], PrintedSolution]) -> Trajectory:
    """Return the trajectory by the printed method, on its mesh."""
    solution = solver()
    return Trajectory(name, solution.t, solution.y)


def by_hopdata() -> Trajectory:
    """Return the trajectory by `hopdata.hybrid.solve`, at MuJoCo's steps."""
    return Trajectory("hopdata", GRID_S, solved(t_eval=GRID_S).y)


def printed_solver(
    options: PrintedOptions,
    *,
    step_s: float = PRINTED_STEP_S,
    rtol: float = SCIPY_RTOL,
) -> Callable[[], PrintedSolution]:
    """Return Algorithm 7 around SciPy's DOPRI5 as a function."""
    from scipy.integrate import RK45

    system = HOPPER.system()
    falling = region_of(system, HOPPER.params, orientation=(-1,))
    rising = region_of(system, HOPPER.params, orientation=(1,))
    limits = {"max_step": step_s, "rtol": rtol, "atol": 1e-3 * rtol}
    solver = Stepping(RK45, limits)

    def run() -> PrintedSolution:
        return integrate_alternating(
            falling, rising, (0.0, UNTIL_S), START, solver=solver, options=options
        )

    return run


def solved(**options: Any) -> Any:
    """Return hopdata's solution."""
    return solve(
        HOPPER.system(),
        (0.0, UNTIL_S),
        START,
        params=HOPPER.params,
        rtol=RTOL,
        atol=0.1 * RTOL,
        **options,
    )


# Table 4.4: the race.


def race(_seed: int) -> dict[str, float]:
    """Return the times of one race, ms, and their ratios to MuJoCo's, as medians."""
    simulation = mujoco_hopper()

    def with_mujoco() -> None:
        simulation.start(START)
        simulation.step_in_python(N_STEPS)

    def with_hopdata() -> None:
        for _ in range(CALLS):
            solved()

    runs = {
        "mujoco": with_mujoco,
        "printed": printed_solver(LETTER),
        "restarted": printed_solver(RESTARTED),
        "tight": printed_solver(RESTARTED, rtol=TIGHT),
        "hopdata": with_hopdata,
    }
    turns_s = in_turn(runs, fewest=TURNS, most=TURNS)
    times = {name: 1e3 * np.array(turns) for name, turns in turns_s.items()}
    times["hopdata"] /= CALLS
    found = {f"{name}_ms": float(np.median(turns)) for name, turns in times.items()}
    for name in ("printed", "restarted", "tight", "hopdata"):
        found[f"{name}_ratio"] = float(np.median(times[name] / times["mujoco"]))
    return found


# Solvers by their names in the rows.
NAMES = {
    "mujoco": "MuJoCo",
    "impedance": "MuJoCo, constant impedance",
    "printed": "printed",
    "restarted": "restarted",
    "tight": "restarted, tight",
    "hopdata": "hopdata",
}


def table_row(
    found: Mapping[str, Trajectory],
    races: Sequence[Mapping[str, float]],
    mujoco_version: str,
) -> Row:
    """Return Table 4.4: times, their ratios, and the errors that belong to them."""
    values: dict[str, Any] = {name: [one[name] for one in races] for name in races[0]}
    values["hopdata_us"] = [1e3 * time for time in values.pop("hopdata_ms")]
    values["hopdata_times_faster"] = [1 / x for x in values.pop("hopdata_ratio")]
    for short, name in NAMES.items():
        values[f"{short}_error_m"] = float(found[name].largest[0])
    values["mujoco"] = mujoco_version
    values["on_par"] = ON_PAR
    as_fast = on_par(float(np.median(values["printed_ratio"])))
    as_fast_restarted = on_par(float(np.median(values["restarted_ratio"])))
    as_exact = values["printed_error_m"] < values["mujoco_error_m"]
    as_exact_restarted = values["restarted_error_m"] < values["mujoco_error_m"]
    if as_fast and as_exact:
        return Row(94, Agreement.AGREES, values)
    # Being as fast does not count where the result is wrong.
    if as_fast_restarted and as_exact_restarted:
        return Row(94, Agreement.PARTLY, values, "tail")
    return Row(94, Agreement.DIFFERS, values, "tail")


# Fig. 4.3: the trajectories.


def figure_row(found: Mapping[str, Trajectory]) -> Row:
    """Return Fig. 4.3: largest residuals, and numbers of points of the meshes."""
    values: dict[str, Any] = {}
    for short in ("mujoco", "printed", "tight", "hopdata"):
        one = found[NAMES[short]]
        height, velocity = one.largest
        values[f"{short}_height_m"] = float(height)
        values[f"{short}_velocity_m_s"] = float(velocity)
        values[f"{short}_points"] = len(one.time_s)
    mujoco = found["MuJoCo"].largest
    if np.all(found["printed"].largest < mujoco):
        return Row(95, Agreement.AGREES, values)
    if np.all(found["restarted, tight"].largest < mujoco):
        return Row(95, Agreement.PARTLY, values, "tail")
    return Row(95, Agreement.DIFFERS, values, "tail")


# Energy.


def energy_row(hopdata: Trajectory) -> Row:
    """Return whether the energy shows where a solver errs, as section 1.3.6 proposes.

    The printed method errs in the steps that hold a contact, where it interpolates and
    takes a step without error control.
    """
    solution = printed_solver(LETTER, step_s=FOLLOWED_STEP_S)()
    followed = Trajectory("followed", solution.t, solution.y)
    changes = np.abs(np.diff(followed.energy))
    touched = steps_with_events(solution)
    inside, outside = float(changes[touched].sum()), float(changes[~touched].sum())
    values: dict[str, Any] = {
        "steps": len(changes),
        "contact_steps": int(touched.sum()),
        "share_percent": 100.0 * inside / (inside + outside),
        "printed_change": float(np.abs(followed.energy).max()),
        "hopdata_change": float(np.abs(hopdata.energy).max()),
    }
    per_touched = inside / touched.sum()
    per_other = outside / (~touched).sum()
    found = per_touched > CLEARLY * per_other
    if found and values["hopdata_change"] < ROUNDING:
        return Row(12, Agreement.AGREES, values)
    if found:
        return Row(12, Agreement.PARTLY, values)
    return Row(12, Agreement.DIFFERS, values)


def steps_with_events(solution: PrintedSolution) -> np.ndarray:
    """Return which steps of a mesh, (N - 1,), begin or end at a contact."""
    at_event = np.isin(solution.t, solution.events.time)
    return np.asarray(at_event[1:] | at_event[:-1])


def gain_row(found: Mapping[str, Trajectory], seeds: Sequence[int]) -> Row:
    """Return how MuJoCo's hopper gains energy, from apex to apex."""
    apexes = hopping_apexes(mujoco_hopper(), START[0]) - START[0]
    changes = over_seeds(gains, seeds)
    values: dict[str, Any] = {
        "hops": len(apexes) - 1,
        "first_mm": 1e3 * float(apexes[1]),
        "highest_mm": 1e3 * float(apexes.max()),
        "lowest_mm": 1e3 * float(apexes.min()),
        "last_mm": 1e3 * float(apexes[-1]),
        "gaining_percent": [100.0 * float(np.mean(one > 0.0)) for one in changes],
        "largest_gain_percent": [100.0 * float(one.max()) for one in changes],
        "largest_loss_percent": [-100.0 * float(one.min()) for one in changes],
        "hopdata_change": float(np.abs(found["hopdata"].energy).max()),
        "tight_change": float(found["restarted, tight"].energy[-1]),
        "drops": DROPS,
    }
    share = 0.01 * float(np.median(values["gaining_percent"]))
    if share >= NEARLY_ALL:
        return Row(96, Agreement.AGREES, values)
    if values["first_mm"] > 0.0:
        return Row(96, Agreement.PARTLY, values, "phase")
    return Row(96, Agreement.DIFFERS, values, "phase")


def gains(seed: int) -> FloatArray:
    """Return the relative changes of energy from apex to apex in random drops, (n,)."""
    simulation = mujoco_hopper()
    drops = START[0] + np.random.default_rng(seed).uniform(-RANGE_M, RANGE_M, DROPS)
    changes = []
    for drop in drops:
        apexes = hopping_apexes(simulation, float(drop))
        changes.append(np.diff(apexes) / apexes[:-1])
    return np.concatenate(changes)


def hopping_apexes(simulation: Simulation, drop_m: float) -> FloatArray:
    """Return the height of the drop and of all apexes after it, m."""
    count = round(HOPPING_S / TIMESTEP_S)
    heights = simulation.roll_out((drop_m, 0.0), count)[0]
    return np.concatenate([[drop_m], apex_heights(heights)])


def apex_heights(heights_m: FloatArray) -> FloatArray:
    """Return the apex of each flight, m, from heights at equal times, (N,).

    At the apex all energy is that of height, so that no convention about velocities
    between two steps enters. A flight in equal steps is a parabola, whose apex follows
    from three points.
    """
    before, at, after = heights_m[:-2], heights_m[1:-1], heights_m[2:]
    is_apex = (at >= before) & (at > after) & (at > HOPPER.contact_length_m)
    low, high, next_one = before[is_apex], at[is_apex], after[is_apex]
    bend = low - 2.0 * high + next_one
    return np.asarray(high - (next_one - low) ** 2 / (8.0 * bend))
