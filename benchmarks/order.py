# ruff: noqa: ARG001 (the integrator prescribes the signature of a field)
"""Order of the printed method and of ours on table 4.3, and the bounds of Theorem 4.2.1.

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

`theorem.csv`, beside it, has one row per mesh, place of the event in its step, and
step: measured errors and proven bounds, their constants (error over dt^4), and the
constants of table 4.1.

`dense.csv`, beside it, has one row per method and longest step. `error_end` is the
largest deviation of the final state, `error_between` that of `solution(t)` at 2,001
times through all events, and `order_between` the slope from the row before.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from restarted import restarted
from scipy.integrate import RK45

from hopdata.arrays import FloatArray
from hopdata.hybrid import System, field, solve
from hopdata.hybrid.printed import (
    PrintedOptions,
    Stepping,
    coefficients,
    hermite,
    heun3_step,
    illinois,
    integrate,
    region_of,
)
from hopdata.hybrid.printed.region import Slope
from hopdata.scenes.octant import INITIAL_STATE, T_SPAN, octant, octant_end

# Order of a method from errors at many step sizes: a line through the straight part,
# and its limit.
#
# The slope of the line is a mean over its steps. The order is the slope in the limit of
# short steps, where the next term of the error's expansion vanishes. The limit fit
# therefore includes that term, over steps that fit several times into the shortest
# smooth piece of the trajectory.

LEAST_ERROR, MOST_ERROR = 1e-12, 1e-3
DEVIATION = 0.1  # largest distance of an error from the line, decades
FEWEST = 4
STEPS_PER_PIECE = 4  # steps per smooth piece from which a method is near its limit


@dataclass(frozen=True)
class OrderFit:
    """A line through the logarithms: error = factor step^order, over the steps that are `used`.

    Parameters
    ----------
    order, factor : float
        NaN where fewer than four steps are straight.
    used : (N,) array of bool
        Which steps the line was fitted to.
    standard_error : float
        Standard error of the order, from the scatter about the line.
    """

    order: float
    factor: float
    used: NDArray[np.bool_]
    standard_error: float

    def error(self, step: FloatArray) -> FloatArray:
        """Return the line's error at given steps."""
        return self.factor * step**self.order


def fit_order(
    step: FloatArray,
    error: FloatArray,
    *,
    least: float = LEAST_ERROR,
    most: float = MOST_ERROR,
    deviation: float = DEVIATION,
) -> OrderFit:
    """Fit the order of a method over the straight part of its curve, chosen by a fixed rule.

    Candidates are steps with errors between `least` (well above rounding) and `most`.
    The fit uses the finest of them and as many consecutive coarser ones as leave every
    error within `deviation` decades of the line through them.

    Parameters
    ----------
    step, error : (N,) array
        Step sizes in any order, and the error at each.
    least, most : float
        Range of errors that may be used.
    deviation : float
        Largest distance of an error from the line, decades.
    """
    order = np.argsort(step)
    inside = [int(i) for i in order if least <= error[i] <= most]
    for count in range(len(inside), FEWEST - 1, -1):
        chosen = inside[:count]
        x, y = np.log10(step[chosen]), np.log10(error[chosen])
        (slope, shift), (slope_error, _), residual = _regression(
            np.stack([x, np.ones(count)]), y
        )
        if np.abs(residual).max() <= deviation:
            used = np.zeros(len(step), dtype=bool)
            used[chosen] = True
            return OrderFit(float(slope), float(10.0**shift), used, float(slope_error))
    return OrderFit(np.nan, np.nan, np.zeros(len(step), dtype=bool), np.nan)


@dataclass(frozen=True)
class LimitFit:
    """The order in the limit of short steps: error = factor step^order exp(bend step).

    Parameters
    ----------
    order, standard_error, bend : float
        NaN if there are fewer than five steps.
    n_steps : int
        Number of steps in the fit.
    """

    order: float
    standard_error: float
    bend: float
    n_steps: int


def fit_limit(
    step: FloatArray,
    error: FloatArray,
    shortest_piece: float,
    *,
    least: float = LEAST_ERROR,
) -> LimitFit:
    """Fit order and next term over all short steps with errors well above rounding.

    Parameters
    ----------
    step, error : (N,) array
        Step sizes in any order, and the error at each.
    shortest_piece : float
        Shortest time between two events, or between an event and an end of the
        trajectory.
    least : float
        Least error that is used.
    """
    used = (step <= shortest_piece / STEPS_PER_PIECE) & (error >= least)
    count = int(used.sum())
    if count < FEWEST + 1:
        return LimitFit(np.nan, np.nan, np.nan, count)
    rows = np.stack([np.log(step[used]), step[used], np.ones(count)])
    (order, bend, _), errors, _ = _regression(rows, np.log(error[used]))
    return LimitFit(float(order), float(errors[0]), float(bend), count)


def _regression(
    rows: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return least-squares coefficients of the rows, their standard errors, and the residual."""
    coefficients = np.asarray(
        np.linalg.lstsq(rows.T, y, rcond=None)[0], dtype=np.float64
    )
    residual: FloatArray = y - coefficients @ rows
    variance = residual @ residual / max(len(y) - len(rows), 1)
    errors: FloatArray = np.sqrt(np.diag(np.linalg.inv(rows @ rows.T)) * variance)
    return coefficients, errors, residual


# Theorem 4.2.1 in numbers: the error of one localised event, and its proven bound.
#
# On a step of length dt with one event at t*, let p be the Hermite cubic through states
# and slopes at its ends, and t' the root of the Hermite cubic of the event function.
# Then
#
#     |t' - t*| <= (L / 24 + L_h K) / c dt^4,
#     |p(t') - y(t*)| <= ((L / 24 + L_h K) / c L_p + K) dt^4
#
# in the largest component, with the constants of table 4.1. They are suprema or infima
# over the step; here they are computed for polynomials and for the known solution on a
# fine grid that includes both ends. The table defines L with the true solution, but the
# proof needs h along p, which is used here.

# An event on a trajectory in closed form, against which errors are measured.


@dataclass(frozen=True)
class KnownEvent:
    """A trajectory known in closed form, and a quadratic event function that it crosses.

    Parameters
    ----------
    slope : callable
        Field ``slope(t, y) -> (n,)``.
    derivative : callable
        ``derivative(k, t) -> (n, ...)``: k-th derivative of the solution at times t
        (...).
    hessian : (n, n) array
        Symmetric H of h(y) = y H y / 2 + gradient y + offset.
    gradient : (n,) array
        Linear coefficients of h.
    offset : float
        Constant term of h.
    time : float
        Instant t* of the event, s.
    """

    slope: Callable[[float, FloatArray], FloatArray]
    derivative: Callable[[int, FloatArray], FloatArray]
    hessian: FloatArray
    gradient: FloatArray
    offset: float
    time: float

    def height(self, y: FloatArray) -> float:
        """Return h at a state (n,)."""
        return float(0.5 * y @ self.hessian @ y + self.gradient @ y + self.offset)

    def rate(self, y: FloatArray, dy: FloatArray) -> float:
        """Return the rate of h at a state that moves at dy, 1/s."""
        return float((self.hessian @ y + self.gradient) @ dy)


def turning_point() -> KnownEvent:
    """Return an event where a helix that closes in on a plane crosses a paraboloid."""
    time, instant = 0.7, np.array(0.7)
    hessian = np.array([[0.6, 0.2, 0.0], [0.2, -0.4, 0.3], [0.0, 0.3, 0.5]])
    gradient = np.array([-0.3, 1.5, -0.4])
    y = turning_derivative(0, instant)
    offset = -float(0.5 * y @ hessian @ y + gradient @ y)
    return KnownEvent(
        turning_slope, turning_derivative, hessian, gradient, offset, time
    )


def turning_slope(_: float, y: FloatArray) -> FloatArray:
    """Return the field of the helix: two components rotate, the third decays."""
    return np.array([-y[1], y[0], -y[2]])


def turning_derivative(k: int, t: FloatArray) -> FloatArray:
    """Return the k-th derivative (3, ...) of (cos t, sin t, exp(-t))."""
    turned = t + k * np.pi / 2
    return np.array([np.cos(turned), np.sin(turned), (-1) ** k * np.exp(-t)])


MESHES = ("exact", "dopri5", "heun3")
GRID = 513
LARGEST_FOURTH = 1 / 384  # maximum of theta^2 (1 - theta)^2 / 4!
LARGEST_SLOPE_BASIS = 4 / 27  # maximum of theta^2 (1 - theta)

Ends = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class Constants:
    """Constants of table 4.1 on one step; L is `fourth`, c is `liveness`, L_p is `speed`."""

    fourth: float
    lipschitz: float
    spline: float
    liveness: float
    speed: float

    @property
    def of_time(self) -> float:
        """Factor of dt^4 in the bound on the time, s^-3."""
        return (self.fourth / 24 + self.lipschitz * self.spline) / self.liveness

    @property
    def of_state(self) -> float:
        """Factor of dt^4 in the bound on the state."""
        return self.of_time * self.speed + self.spline


@dataclass(frozen=True)
class Localisation:
    """Errors in the time, s, and the state of one event, with its step and constants."""

    dt: float
    time_error: float
    state_error: float
    constants: Constants

    @property
    def time_bound(self) -> float:
        """Proven bound on `time_error`, s."""
        return self.constants.of_time * self.dt**4

    @property
    def state_bound(self) -> float:
        """Proven bound on `state_error`."""
        return self.constants.of_state * self.dt**4


def localise(
    event: KnownEvent, dt: float, *, part: float = 0.4, mesh: str = "exact"
) -> Localisation:
    """Localise an event on one step as Algorithms 5 and 6 do, and compute the proven bounds.

    Parameters
    ----------
    event : KnownEvent
        Solution and event function.
    dt : float
        Length of the step, s.
    part : float
        Position of the event in the step, 0 to 1.
    mesh : str
        ``"exact"``: both ends lie on the solution; ``"dopri5"``, ``"heun3"``: the
        second is reached from the first by one step of Dormand-Prince, or of Heun's
        third-order method.
    """
    start = event.time - part * dt
    ends = mesh_ends(event, start, dt, mesh)
    root = _root(event, ends, dt)
    found, true = hermite(root, *ends, dt), event.derivative(0, np.array(event.time))
    return Localisation(
        dt=dt,
        time_error=abs(start + root * dt - event.time),
        state_error=float(np.abs(found - true).max()),
        constants=constants(event, start, dt, ends),
    )


def mesh_ends(event: KnownEvent, start: float, dt: float, mesh: str) -> Ends:
    """Return states and slopes (y0, y1, f0, f1) at both ends of a step."""
    if mesh not in MESHES:
        raise ValueError(f"mesh: expected one of {', '.join(MESHES)}, found {mesh}")
    y0 = event.derivative(0, np.array(start))
    f0 = event.slope(start, y0)
    if mesh == "exact":
        y1 = event.derivative(0, np.array(start + dt))
    else:
        one_step = dopri5_end if mesh == "dopri5" else heun3_step
        y1 = one_step(event.slope, start, y0, f0, dt)
    return y0, y1, f0, event.slope(start + dt, y1)


def dopri5_end(
    slope: Slope, t: float, y: FloatArray, f: FloatArray, dt: float
) -> FloatArray:
    """Return the state after one step of Dormand-Prince."""
    k = [f]
    for row, node in zip(RK45.A[1:], RK45.C[1:], strict=True):
        k.append(slope(t + node * dt, y + dt * (row[: len(k)] @ np.array(k))))
    return y + dt * (RK45.B @ np.array(k))


def constants(event: KnownEvent, start: float, dt: float, ends: Ends) -> Constants:
    """Return the constants of table 4.1 on the step from `start` with these ends."""
    theta = np.linspace(0.0, 1.0, GRID)
    times = start + dt * theta
    y, dy = event.derivative(0, times), event.derivative(1, times)
    p = spline_polynomials(ends, dt)
    along = np.array([one(theta) for one in p])
    rates = np.einsum("it,it->t", event.hessian @ y + event.gradient[:, None], dy)
    if rates.min() <= 0.0:
        raise ValueError("the event function is not live on the whole step")
    return Constants(
        fourth=float(np.abs(_height_along(event, p).deriv(4)(theta)).max()) / dt**4,
        lipschitz=_lipschitz(event, np.concatenate([y, along], axis=1)),
        spline=_spline_constant(event, start, dt, ends, times),
        liveness=float(rates.min()),
        speed=max(float(np.abs(one.deriv()(theta)).max()) for one in p) / dt,
    )


def spline_polynomials(ends: Ends, dt: float) -> list[Polynomial]:
    """Return the Hermite cubic of each component as a polynomial in theta."""
    y0, y1, f0, f1 = ends
    return [
        Polynomial(row) for row in np.transpose(coefficients(y0, y1, dt * f0, dt * f1))
    ]


def _root(event: KnownEvent, ends: Ends, dt: float) -> float:
    y0, y1, f0, f1 = ends
    slopes = dt * event.rate(y0, f0), dt * event.rate(y1, f1)
    return illinois(coefficients(event.height(y0), event.height(y1), *slopes))


def _height_along(event: KnownEvent, p: list[Polynomial]) -> Polynomial:
    """Return h along the spline, g = h(p), a polynomial of degree six in theta."""
    linear = sum(
        (q * one for q, one in zip(event.gradient, p, strict=True)), Polynomial([0.0])
    )
    products = (
        0.5 * event.hessian[i, j] * p[i] * p[j]
        for i in range(len(p))
        for j in range(len(p))
    )
    return linear + sum(products, Polynomial([event.offset]))


def _lipschitz(event: KnownEvent, points: FloatArray) -> float:
    """Return a Lipschitz constant of h, in the largest component, on the bounding box of points."""
    low, high = points.min(axis=1), points.max(axis=1)
    middle = event.hessian @ (0.5 * (low + high)) + event.gradient
    return float((np.abs(middle) + np.abs(event.hessian) @ (0.5 * (high - low))).sum())


def _spline_constant(
    event: KnownEvent, start: float, dt: float, ends: Ends, times: FloatArray
) -> float:
    """Return K: the part of the exact Hermite cubic plus the effect of errors at the step's end."""
    _, y1, _, f1 = ends
    end = np.array(start + dt)
    off = np.abs(y1 - event.derivative(0, end)).max()
    slope_off = np.abs(f1 - event.derivative(1, end)).max()
    fourth = np.abs(event.derivative(4, times)).max()
    return float(
        LARGEST_FOURTH * fourth + (off + LARGEST_SLOPE_BASIS * dt * slope_off) / dt**4
    )


# The default here; it chooses its order at each step, so no order is fitted
TAYLOR = "taylor"
Run = Callable[[float, float], FloatArray]  # longest step, first step: final state

LONGEST, SHORTEST = 0.5, 5e-4
PRINTED_STEPS, OUR_STEPS = (
    31,
    61,
)  # plain Python is slow; higher orders need a finer grid
LOOSE = {"rtol": 0.9, "atol": 1e9}
THEOREM_STEPS = 0.5 / 2.0 ** np.arange(8)
PLACES = (0.1, 0.4, 0.5, 0.9)


def printed(kind: Callable[..., object], options: PrintedOptions | None = None) -> Run:
    """Return a function that runs the printed method around a class of steppers."""
    region = region_of(octant())

    def run(max_step: float, first_step: float) -> FloatArray:
        solver = Stepping(
            kind, {**LOOSE, "max_step": max_step, "first_step": first_step}
        )
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


def theorem_row(mesh: str, place: float, found: Localisation) -> dict[str, object]:
    """Return measured errors and proven bounds side by side."""
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
    """Print the orders, and how close the measured errors come to the bounds."""
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
    theorem = theorem_table()
    report_theorem(theorem)
    theorem.to_csv(arguments.out.with_name("theorem.csv"), index=False)
    dense = dense_table()
    dense.to_csv(arguments.out.with_name("dense.csv"), index=False)
    print(dense.to_string(index=False))


if __name__ == "__main__":
    main()
