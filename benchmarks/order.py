# ruff: noqa: ARG001 (the integrator prescribes the signature of a field)
"""Order of the printed method, of ours and of SciPy's on table 4.3.

    python benchmarks/order.py --out order.csv

`order.csv` has one row per method and longest step. All methods take steps of one
length (the tolerances are so loose that they never shorten a step). `error_rms` is the
root mean square deviation of the final state from the exact one, over its components
and over runs. The runs shorten the first step by different fractions, so that the
events fall anywhere within their steps. `in_fit` marks the straight part of the curve,
chosen by the rule of `fit_order`; `fitted_order` and `fitted_error` describe the line
through it. "slopes kept" is Algorithm 5 to the letter.

The slope of a line is a mean over its steps, whereas an order is a limit. Here
Dormand-Prince approaches its order from below: at a rate r = 10 its error goes as (r
dt)^5 (1 - 5/7 r dt). Therefore `limit_order` comes from a fit of error = factor
dt^order exp(bend dt) over all steps that fit at least four times into the shortest
piece between events and whose errors are above 1e-12 (`fit_limit`); this rule is the
same for all methods. `local_order` is the slope between a step and the next shorter
one. Columns ending in `_se` are standard errors from the scatter about line or curve.

`dense.csv`, beside it, has one row per method and longest step. `error_end` is the
largest deviation of the final state, `error_between` that of `solution(t)` at 2,001
times through all events, and `order_between` the slope from the row before.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from restarted import restarted
from scipy.integrate import RK45

from hopdata.arrays import FloatArray
from hopdata.hybrid import System, field, solve
from hopdata.hybrid.printed import (
    PrintedOptions,
    integrate,
    region_of,
)
from hopdata.hybrid.printed.order import LOOSE, equal_steps, fit_limit, fit_order
from hopdata.scenes.octant import INITIAL_STATE, T_SPAN, octant, octant_end

# The default here; it chooses its order at each step, so no order is fitted
TAYLOR = "taylor"
Run = Callable[[float, float], FloatArray]  # longest step, first step: final state

LONGEST, SHORTEST = 0.5, 5e-4
PRINTED_STEPS, OUR_STEPS = (
    31,
    61,
)  # plain Python is slow; higher orders need a finer grid


def printed(kind: Callable[..., object], options: PrintedOptions | None = None) -> Run:
    """Return a function that runs the printed method around a class of steppers."""
    region = region_of(octant())

    def run(max_step: float, first_step: float) -> FloatArray:
        solver = equal_steps(kind, max_step, first_step)
        return integrate(
            region, T_SPAN, INITIAL_STATE, solver=solver, options=options
        ).y_end

    return run


def ours(**method: str) -> Run:
    """Return a function that runs `solve` by a method."""

    def run(max_step: float, first_step: float) -> FloatArray:
        steps = {"max_step": max_step, "first_step": first_step}
        return solve(octant(), T_SPAN, INITIAL_STATE, **LOOSE, **steps, **method).y_end

    return run


def scipy_alone() -> Run:
    """Return a function that runs `solve_ivp`, restarted at each event."""
    integrate = restarted(octant(), (), T_SPAN, INITIAL_STATE)

    def run(max_step: float, first_step: float) -> FloatArray:
        first = min(first_step, T_SPAN[1] - T_SPAN[0])
        return integrate(method="RK45", max_step=max_step, first_step=first, **LOOSE)[0]

    return run


def methods() -> dict[str, tuple[Run, int]]:
    """Return a run and the number of step sizes for each available method."""
    runs: dict[str, tuple[Run, int]] = {
        "printed, DOPRI5, Illinois": (printed(RK45), PRINTED_STEPS),
        "printed, DOPRI5, cubic": (printed(RK45, PrintedOptions("cubic")), PRINTED_STEPS),
        "printed, DOPRI5, slopes kept": (
            printed(RK45, PrintedOptions(refresh_slopes=False)), PRINTED_STEPS,
        ),
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
    """Return the rms error of the final state over components and first steps."""
    parts = (np.arange(runs) + 0.5) / runs
    return float(
        np.sqrt(np.mean([(run(step, part * step) - exact) ** 2 for part in parts]))
    )


def shortest_piece() -> float:
    """Return the shortest time between two events, or between an event and start or end."""
    times = solve(octant(), T_SPAN, INITIAL_STATE).events.time
    return float(np.diff([T_SPAN[0], *times, T_SPAN[1]]).min())


@field
def growth(
    t: float, y: FloatArray, mode: NDArray[np.int64], params: FloatArray, dy: FloatArray
) -> None:
    dy[0] = 10.0 * y[0] + 1.0  # as x does after the last event


def report_without_events(runs: int) -> None:
    """Print the order of DOPRI5 on the last piece alone, from x = 0 on, without guards."""
    system = System(growth, n_states=1)
    span = (
        0.0,
        T_SPAN[1] - float(solve(octant(), T_SPAN, INITIAL_STATE).events.time[-1]),
    )

    def run(max_step: float, first_step: float) -> FloatArray:
        steps = {"max_step": max_step, "first_step": first_step}
        return solve(system, span, [0.0], method="dopri5", **LOOSE, **steps).y_end

    steps, exact = (
        np.geomspace(LONGEST, SHORTEST, OUR_STEPS),
        np.expm1([10.0 * span[1]]) / 10.0,
    )
    errors = np.array([error_rms(run, step, exact, runs) for step in steps])
    fit, limit = fit_order(steps, errors), fit_limit(steps, errors, span[1])
    print(
        f"hopdata, dopri5, without events: order {fit.order:5.2f} +- {fit.standard_error:.2f}, "
        f"in the limit {limit.order:5.2f} +- {limit.standard_error:.2f}"
    )


def order_rows(
    name: str, run: Run, count: int, exact: FloatArray, runs: int
) -> pd.DataFrame:
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
            "local_order": np.append(
                np.diff(np.log(errors)) / np.diff(np.log(steps)), np.nan
            ),
            "limit_order": limit.order,
            "limit_order_se": limit.standard_error,
            "limit_steps": limit.n_steps,
        }
    )


def dense_table() -> pd.DataFrame:
    """Return the errors of dense output through the events of table 4.3, at steps of one length."""
    times, rows = np.linspace(*T_SPAN, 2001), []
    exact = solve(octant(), T_SPAN, INITIAL_STATE, method="taylor", dense_output=True)
    for method in ("dopri5", "dop853", "rosenbrock"):
        before = None
        for count in (4, 8, 16, 32, 64, 128):
            step = (T_SPAN[1] - T_SPAN[0]) / count
            found = solve(
                octant(), T_SPAN, INITIAL_STATE, method=method, dense_output=True, rtol=0.99,
                atol=1e9, first_step=step, max_step=step,
            )  # fmt: skip
            error = float(np.abs(found(times) - exact(times)).max())
            rows.append({
                "method": method, "step": step, "error_between": error,
                "error_end": float(np.abs(found.y_end - exact.y_end).max()),
                "order_between": np.nan if before is None else np.log2(before / error),
            })  # fmt: skip
            before = error
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--out", type=Path, required=True, help="CSV file of the orders"
    )
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
    dense = dense_table()
    dense.to_csv(arguments.out.with_name("dense.csv"), index=False)
    print(dense.to_string(index=False))


if __name__ == "__main__":
    main()
