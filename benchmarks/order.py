# ruff: noqa: ARG001 (the integrator prescribes the signature of a field)
"""Order of the printed method and of ours on table 4.3, and Theorem 4.2.1 in numbers.

    python benchmarks/order.py --out order.csv

`order.csv`: one row a method and longest step. All take steps of one length (tolerances so loose
that they never shorten one). `error_rms` is the root mean square deviation of the final state from
the exact one, over its components and over runs whose first steps are cut by different parts of a
step, so that the events fall everywhere in theirs. `in_fit` marks the straight part of the curve,
chosen by the rule of `order_fit.fit_order`; `fitted_order` and `fitted_error`
are the line through it. "slopes kept" is Algorithm 5 to the letter.

A line's slope is a mean over its steps, and an order is a limit. Dormand-Prince's is approached
from below here: at a rate r = 10 its error goes as (r dt)^5 (1 - 5/7 r dt). So `limit_order` is
from a fit of error = factor dt^order exp(bend dt), over all steps of which four fit into the
shortest piece between events and whose errors are above 1e-12 (`fit_limit`): one rule for all
methods. `local_order` is the slope between a step and the next shorter one. Columns `_se` are
standard errors from the scatter about line or curve.

`theorem.csv`, beside it: one row a mesh, a place of the event in its step and a step: measured
errors and proven bounds, their constants (error over dt^4), and the constants of table 4.1.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from exact import octant_end
from numpy.typing import NDArray
from order_fit import fit_limit, fit_order
from restarted import restarted
from scipy.integrate import RK45

from hopdata.hybrid import System, field, solve
from hopdata.hybrid.printed import Dopri5, PrintedOptions, Stepping, integrate, region_of
from hopdata.hybrid.printed.theorem import MESHES, Localisation, localise, turning_point
from hopdata.scenes.small import INITIAL_STATE, T_SPAN, octant

FloatArray = NDArray[np.float64]
TAYLOR = "taylor"  # the default here; its order is chosen step by step, so that none is fitted
Run = Callable[[float, float], FloatArray]  # longest step, first step: final state

LONGEST, SHORTEST = 0.5, 5e-4
PRINTED_STEPS, OUR_STEPS = 31, 61  # plain Python is slow; higher orders need a finer grid
LOOSE = {"rtol": 0.9, "atol": 1e9}
THEOREM_STEPS = 0.5 / 2.0 ** np.arange(8)
PLACES = (0.1, 0.4, 0.5, 0.9)


def printed(kind: Callable[..., object], options: PrintedOptions | None = None) -> Run:
    """Return a run of the printed method around a class of steppers."""
    region = region_of(octant())

    def run(max_step: float, first_step: float) -> FloatArray:
        solver = Stepping(kind, {**LOOSE, "max_step": max_step, "first_step": first_step})
        return integrate(region, T_SPAN, INITIAL_STATE, solver=solver, options=options).y_end

    return run


def ours(**method: str) -> Run:
    """Return a run of `solve` by a method."""

    def run(max_step: float, first_step: float) -> FloatArray:
        steps = {"max_step": max_step, "first_step": first_step}
        return solve(octant(), T_SPAN, INITIAL_STATE, **LOOSE, **steps, **method).y_end

    return run


def scipy_alone() -> Run:
    """Return a run of `solve_ivp`, started again at each event."""
    integrate = restarted(octant(), (), T_SPAN, INITIAL_STATE)

    def run(max_step: float, first_step: float) -> FloatArray:
        first = min(first_step, T_SPAN[1] - T_SPAN[0])
        return integrate(method="RK45", max_step=max_step, first_step=first, **LOOSE)[0]

    return run


def methods() -> dict[str, tuple[Run, int]]:
    """Return a run and the number of step sizes for each method that there is."""
    runs: dict[str, tuple[Run, int]] = {
        "printed, DOPRI5, Illinois": (printed(Dopri5), PRINTED_STEPS),
        "printed, DOPRI5, cubic": (printed(Dopri5, PrintedOptions("cubic")), PRINTED_STEPS),
        "printed, DOPRI5, slopes kept": (
            printed(Dopri5, PrintedOptions(refresh_slopes=False)), PRINTED_STEPS,
        ),
        "printed, scipy RK45": (printed(RK45), PRINTED_STEPS),
        "scipy RK45, restarted": (scipy_alone(), PRINTED_STEPS),
    }  # fmt: skip
    for name in ("dopri5", "dop853", TAYLOR):
        run = ours(method=name)
        try:
            run(0.1, 0.1)
        except (TypeError, ValueError) as error:
            print(f"hopdata, {name}: skipped, {error}")
        else:
            runs[f"hopdata, {name}"] = run, OUR_STEPS
    return runs


def error_rms(run: Run, step: float, exact: FloatArray, runs: int) -> float:
    """Return the error of the final state over components and first steps."""
    parts = (np.arange(runs) + 0.5) / runs
    return float(np.sqrt(np.mean([(run(step, part * step) - exact) ** 2 for part in parts])))


def shortest_piece() -> float:
    """Return the shortest time between two events, or an event and start or end."""
    times = solve(octant(), T_SPAN, INITIAL_STATE).events.time
    return float(np.diff([T_SPAN[0], *times, T_SPAN[1]]).min())


@field
def growth(
    t: float, y: FloatArray, mode: NDArray[np.int64], params: FloatArray, dy: FloatArray
) -> None:
    dy[0] = 10.0 * y[0] + 1.0  # as x does after the last event


def report_without_events(runs: int) -> None:
    """Print the order of DOPRI5 on the last piece alone, from x = 0 on, without any guard."""
    system = System(growth, n_states=1)
    span = (0.0, T_SPAN[1] - float(solve(octant(), T_SPAN, INITIAL_STATE).events.time[-1]))

    def run(max_step: float, first_step: float) -> FloatArray:
        steps = {"max_step": max_step, "first_step": first_step}
        return solve(system, span, [0.0], method="dopri5", **LOOSE, **steps).y_end

    steps, exact = np.geomspace(LONGEST, SHORTEST, OUR_STEPS), np.expm1([10.0 * span[1]]) / 10.0
    errors = np.array([error_rms(run, step, exact, runs) for step in steps])
    fit, limit = fit_order(steps, errors), fit_limit(steps, errors, span[1])
    print(
        f"hopdata, dopri5, without events: order {fit.order:5.2f} +- {fit.standard_error:.2f}, "
        f"in the limit {limit.order:5.2f} +- {limit.standard_error:.2f}"
    )


def order_rows(name: str, run: Run, count: int, exact: FloatArray, runs: int) -> pd.DataFrame:
    """Measure one method at all step sizes, and fit its order."""
    steps = np.geomspace(LONGEST, SHORTEST, count)
    errors = np.array([error_rms(run, step, exact, runs) for step in steps])
    fitted = np.full_like(errors, np.nan) if name.endswith(TAYLOR) else errors
    fit, limit = fit_order(steps, fitted), fit_limit(steps, fitted, shortest_piece())
    used = steps[fit.used]
    print(
        f"{name:30} order {fit.order:5.2f} +- {fit.standard_error:.2f} over {len(used):2} steps "
        f"from {used.min(initial=np.inf):.2g} to {used.max(initial=0):.2g}, "
        f"in the limit {limit.order:5.2f} +- {limit.standard_error:.2f} ({limit.n_steps} steps)"
    )
    return pd.DataFrame(
        {
            "scene": "octant",
            "method": name,
            "max_step": steps,
            "error_rms": errors,
            "in_fit": fit.used,
            "fitted_order": fit.order,
            "fitted_order_se": fit.standard_error,
            "fitted_error": fit.error(steps),
            "local_order": np.append(np.diff(np.log(errors)) / np.diff(np.log(steps)), np.nan),
            "limit_order": limit.order,
            "limit_order_se": limit.standard_error,
            "limit_steps": limit.n_steps,
        }
    )


def theorem_row(mesh: str, place: float, found: Localisation) -> dict[str, object]:
    """Return measured and proven, side by side."""
    constants, fourth_power = found.constants, found.dt**4
    return {
        "mesh": mesh,
        "event_at": place,
        "dt": found.dt,
        "time_error": found.time_error,
        "time_bound": found.time_bound,
        "state_error": found.state_error,
        "state_bound": found.state_bound,
        "time_constant_measured": found.time_error / fourth_power,
        "time_constant_proven": constants.of_time,
        "state_constant_measured": found.state_error / fourth_power,
        "state_constant_proven": constants.of_state,
        "L": constants.fourth,
        "L_h": constants.lipschitz,
        "K": constants.spline,
        "c": constants.liveness,
        "L_p": constants.speed,
    }


def theorem_table() -> pd.DataFrame:
    """Measure localisation errors against the theorem's bounds."""
    event = turning_point()
    return pd.DataFrame(
        [
            theorem_row(mesh, place, localise(event, float(dt), part=place, mesh=mesh))
            for mesh in MESHES
            for place in PLACES
            for dt in THEOREM_STEPS
        ]
    )


def report_theorem(table: pd.DataFrame) -> None:
    """Print the orders, and how near the measured errors come to the bounds."""
    for (mesh, place), rows in table.groupby(["mesh", "event_at"]):
        time, state = (
            np.polyfit(np.log(rows["dt"]), np.log(rows[f"{what}_error"]), 1)[0]
            for what in ("time", "state")
        )
        shortest = rows.loc[rows["dt"].idxmin()]
        print(
            f"theorem, mesh {mesh:7} event at {place:3} of the step: "
            f"orders {time:.2f}, {state:.2f}; "
            f"constants of time {shortest['time_constant_measured']:.2e} measured, "
            f"{shortest['time_constant_proven']:.2e} proven, "
            f"of state {shortest['state_constant_measured']:.2e}, "
            f"{shortest['state_constant_proven']:.2e}; largest error over bound "
            f"{(rows['time_error'] / rows['time_bound']).max():.3f}, "
            f"{(rows['state_error'] / rows['state_bound']).max():.3f}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file of the orders")
    parser.add_argument("--runs", type=int, default=32, help="runs of each step size")
    arguments = parser.parse_args()
    exact = octant_end()
    tables = [
        order_rows(name, run, count, exact, arguments.runs)
        for name, (run, count) in methods().items()
    ]
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    pd.concat(tables).to_csv(arguments.out, index=False)
    report_without_events(arguments.runs)
    theorem = theorem_table()
    report_theorem(theorem)
    theorem.to_csv(arguments.out.with_name("theorem.csv"), index=False)


if __name__ == "__main__":
    main()
