# ruff: noqa: ARG001 (the integrator prescribes the signatures of field and guards)
"""Peers of the integrator, and its scenes, written once for every peer.

Each module offers ``solvers(problem) -> list[Solver]``, empty if it does not support
the scene. Our solver is here: one call of `solve` from Python, and its share of a
batch.

All scenes are smooth except for a few coefficients that change at events. `slope` and
`height` use ordinary arithmetic on the entries of the state and receive the elementary
functions to use. So they work with Python numbers, Numba, jax and heyoka's expressions
alike. `coefficients` depends on the locks alone, so a peer evaluates it once per event
instead of once per step; the springs of the plate enter as sums.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from importlib import import_module
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.hybrid import Solution, System, guards, solve, solve_batch
from hopdata.hybrid import field as _field
from hopdata.hybrid.arguments import SMALLEST_RTOL
from hopdata.scenes.octant import INITIAL_STATE, T_SPAN, octant, octant_end
from hopdata.scenes.plate import PLATE_SPAN, PLATE_START, Plate, plate_end
from hopdata.scenes.vertical_hopper import VerticalHopper, hopper_end

# Interface of every peer: named solvers that take a tolerance and return something to
# run.


Found = tuple[FloatArray, int | None]  # final state and number of events
Run = Callable[[], Found]

# If only the nearest guard is watched, an event is placed this far behind the surface,
# so that the guard that has just flipped starts on the right side of zero. It shifts
# the instant by this distance over the crossing speed, which is negligible beside the
# compared errors.
HYSTERESIS = 1e-14
MOST_EVENTS = 10_000
TOLERANCES = tuple(10.0**-k for k in range(3, 14))


@dataclass(frozen=True)
class Solver:
    """One way to integrate a scene.

    Parameters
    ----------
    package : str
        Package of the solver; "hopdata" is ours.
    way : str
        How the package is used: the kind of its user functions, or its caller.
    method : str
        The integration method.
    prepare : callable
        Takes the tolerance (relative and absolute), does all work that can be done
        beforehand, and returns a function that integrates the scene once. That function
        returns the final state and the number of events, None if unknown.
    trajectories : int
        Number of times one call of that function integrates the scene.
    settings : tuple of float
        Tolerances to prepare it for, or time steps if it has no tolerance.
    """

    package: str
    way: str
    method: str
    prepare: Callable[[float], Run]
    trajectories: int = 1
    settings: tuple[float, ...] = TOLERANCES


class LostEventError(RuntimeError):
    """An integration did not reach its end."""


Formula = Callable[..., Any]


@dataclass(frozen=True, eq=False)
class Problem:
    """A scene in the form that peers need.

    Parameters
    ----------
    name : str
        Name of the scene.
    t_span : tuple of float
        Start and end.
    y0 : tuple of float
        Initial state.
    n_guards : int
        Number of event functions h_k; lock k is the sign of h_k, and flips where h_k
        crosses zero.
    slope : callable
        ``slope(m)(y, c)`` is the rate of the state, a tuple, for coefficients c; `m` is
        a module with elementary functions (math, numpy, ...).
    height : callable
        ``height(m)(y, k)`` is h_k; k may be an array of numbers where y holds numbers.
    coefficients : callable
        ``coefficients(locks)`` is c as a tuple, for an array of locks, -1.0 or 1.0.
    system, params
        The same scene for `hopdata.hybrid.solve`.
    end : array
        Exact final state, (n,).
    forms : mapping
        Other forms of that system by name, for the same parameters.
    """

    name: str
    t_span: tuple[float, float]
    y0: tuple[float, ...]
    n_guards: int
    slope: Callable[[Any], Formula]
    height: Callable[[Any], Formula]
    coefficients: Formula
    system: System
    params: tuple[float, ...]
    end: FloatArray
    forms: Mapping[str, System] = field(default_factory=dict)

    @property
    def start(self) -> FloatArray:
        """Initial state, (n,)."""
        return np.array(self.y0, dtype=np.float64)

    @property
    def locks(self) -> FloatArray:
        """Locks at the start, (n_guards,)."""
        return np.where(self.heights(self.start) > 0, 1.0, -1.0)

    @cached_property
    def events(self) -> int:
        """Number of events, from our solver at its tightest tolerance."""
        return tight_solution(self.system, self.t_span, self.y0, self.params).n_events

    def heights(self, y: FloatArray) -> FloatArray:
        """Return all event functions, (n_guards,)."""
        return self.height(np)(y, np.arange(self.n_guards))


def octant_problem() -> Problem:
    """Return table 4.3: x' = c0 x + c1 y + 1, y' = c2 x + c3 y + c4, z' = c5 z - 1."""
    signs = np.array([1.0, 1.0, -1.0])  # z is crossed downwards

    def slope(_: Any) -> Formula:
        def rate(y: Any, c: Any) -> Any:
            return (
                c[0] * y[0] + c[1] * y[1] + 1.0,
                c[2] * y[0] + c[3] * y[1] + c[4],
                c[5] * y[2] - 1,
            )

        return rate

    def height(_: Any) -> Formula:
        def h(y: Any, k: Any) -> Any:
            return signs[k] * y[k]

        return h

    def coefficients(locks: Any) -> Any:
        x, y, z = (locks[0] + 1) / 2, (locks[1] + 1) / 2, (locks[2] + 1) / 2
        return (
            10 * x * y,
            (1 - x) * (2 * y - 1) - 2 * x * (1 - y),
            (1 - x) * (1 - 2 * y) + 0.5 * x * (1 - y),
            x * y,
            1 + x * (1 - y),
            4 * z - 1,
        )

    return Problem(
        "octant", T_SPAN, INITIAL_STATE, 3, slope, height, coefficients,
        octant(), (), octant_end(),
    )  # fmt: skip


def hopper_problem() -> Problem:
    """Return the hopper in one dimension: v' = c0 - c1 z."""
    hopper = VerticalHopper()
    gravity, stiffness, rest, _, contact = hopper.params

    def slope(_: Any) -> Formula:
        def rate(y: Any, c: Any) -> Any:
            return y[1], c[0] - c[1] * y[0]

        return rate

    def height(_: Any) -> Formula:
        def h(y: Any, k: Any) -> Any:
            return y[k] - contact  # k is 0, and the first state is the height

        return h

    def coefficients(locks: Any) -> Any:
        stance = (1 - locks[0]) / 2
        return stance * stiffness * rest - gravity, stance * stiffness

    return Problem(
        "vertical_hopper", (0.0, 2.0), (2.0, 0.0), 1, slope, height, coefficients,
        hopper.system(), hopper.params, hopper_end(hopper, 2.0, 2.0),
    )  # fmt: skip


def plate_problem() -> Problem:
    """Return the plate on 35 springs; c are the sums over the contacts of 1, x_i and x_i^2."""
    plate = Plate()
    gravity, mass, inertia, rest, stiffness, damping, *_ = plate.params
    places = plate.spring_places_m

    def slope(m: Any) -> Formula:
        def rate(y: Any, c: Any) -> Any:
            x, z, angle, vx, vz, omega = y[0], y[1], y[2], y[3], y[4], y[5]
            tan = m.tan(angle)
            grow = 1.0 + tan * tan
            at_centre = stiffness * (rest - z) + damping * (tan * vx - vz)
            per_arm = stiffness * tan + damping * grow * omega
            arms = x * c[0] - c[1]
            squares = x * (arms - c[1]) + c[2]
            force = (at_centre * c[0] + per_arm * arms) / mass
            moment = (at_centre * arms + per_arm * squares) / inertia
            return vx, vz, omega, -tan * force, force - gravity, -grow * moment

        return rate

    def height(m: Any) -> Formula:
        def h(y: Any, k: Any) -> Any:
            tan = m.tan(y[2])
            return (
                rest - y[1] + tan * y[0] - tan * places[k]
            )  # the first part is common to all

        return h

    def coefficients(locks: Any) -> Any:
        touching = (locks + 1) / 2
        return (
            touching.sum(),
            (touching * places).sum(),
            (touching * places * places).sum(),
        )

    return Problem(
        "plate", PLATE_SPAN, PLATE_START, plate.n_contacts, slope, height, coefficients,
        plate.system(), plate.params, plate_end(),
        {"sums": plate.system(sums=True), "sparse": plate.system(sparse=True)},
    )  # fmt: skip


# Five systems from elsewhere, piecewise smooth, each with the lock of a guard in its
# field.

TILT = 0.25  # angle of a rocking block, from its edge to its centre of mass, rad
LOW, HIGH, CURRENT, SLOW = (
    0.125,
    0.625,
    0.5,
    0.1,
)  # McKean's neuron: its kinks, drive and rate
INNER, OUTER, ALPHA, BETA = (
    -8 / 7,
    -5 / 7,
    15.6,
    28.0,
)  # Chua's circuit: its slopes and parameters
SUPPLY, WANTED, GAIN, LOAD, CARRIER = (
    2.0,
    0.9,
    1.5,
    0.8,
    9.0,
)  # a buck converter, scaled
BACKLASH, DAMPING, TORQUE, WOBBLE = 0.5, 0.1, 0.3, 0.7  # a pair of gears


@_field
def block_field(t, y, mode, params, dy):
    dy[0], dy[1] = y[1], -math.sin(TILT * mode[0] - y[0])


@_field
def neuron_field(t, y, mode, params, dy):
    low, high = mode[0] > 0, mode[1] > 0
    slope, offset = (
        2.0 * low - 2.0 * high - 1.0,
        (1.0 + 2.0 * LOW) * high - 2.0 * LOW * low,
    )
    dy[0], dy[1] = slope * y[0] + offset - y[1] + CURRENT, SLOW * y[0]


@_field
def chua_field(t, y, mode, params, dy):
    low, high = 1.0 * (mode[0] > 0), 1.0 * (mode[1] > 0)
    diode = (OUTER + (INNER - OUTER) * (low - high)) * y[0] + (INNER - OUTER) * (
        low + high - 1.0
    )
    dy[0] = ALPHA * (y[1] - y[0] - diode)
    dy[1], dy[2] = y[0] - y[1] + y[2], -BETA * y[1]


@_field
def converter_field(t, y, mode, params, dy):
    closed = 0.5 * (1.0 - mode[0])
    dy[0], dy[1] = closed * SUPPLY - y[1], y[0] - y[1] / LOAD
    dy[2], dy[3] = CARRIER * y[3], -CARRIER * y[2]


@_field
def gears_field(t, y, mode, params, dy):
    low, high = 1.0 * (mode[0] < 0), 1.0 * (mode[1] > 0)
    mesh = (low + high) * y[0] + (low - high) * BACKLASH
    dy[0], dy[1] = y[1], TORQUE + WOBBLE * y[2] - DAMPING * y[1] - mesh
    dy[2], dy[3] = y[3], -y[2]


@guards
def carrier_guard(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = GAIN * (y[1] - WANTED) - y[2], GAIN * dy[1] - dy[2]


@guards
def zero_guard(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0], dy[0]


@guards
def two_guards(t, y, dy, mode, params, h, hdot):
    for k in range(2):
        h[k], hdot[k] = y[0] - params[k], dy[0]


def others() -> list[Problem]:
    """Return a rocking block, a neuron, a circuit, a switched converter and a pair of gears.

    Housner's block loses no energy. McKean's neuron and Chua's circuit have their usual
    form. The buck converter is switched where its error meets a sine, and the gears
    have backlash and are driven by a sine; each carries its sine as two states.

    Their exact ends are our own at the tightest tolerance, so no solver's error is
    reported below 1e-12.
    """

    def block_slope(m: Any) -> Formula:
        return lambda y, c: (y[1], -m.sin(c[0] - y[0]))

    def neuron_slope(_: Any) -> Formula:
        return lambda y, c: (c[0] * y[0] + c[1] - y[1] + CURRENT, SLOW * y[0])

    def chua_slope(_: Any) -> Formula:
        return lambda y, c: (
            ALPHA * (y[1] - y[0] - c[0] * y[0] - c[1]), y[0] - y[1] + y[2], -BETA * y[1],
        )  # fmt: skip

    def converter_slope(_: Any) -> Formula:
        return lambda y, c: (
            c[0] - y[1], y[0] - y[1] / LOAD, CARRIER * y[3], -CARRIER * y[2],
        )  # fmt: skip

    def gears_slope(_: Any) -> Formula:
        return lambda y, c: (
            y[1], TORQUE + WOBBLE * y[2] - DAMPING * y[1] - c[0] * y[0] - c[1], y[3], -y[2],
        )  # fmt: skip

    def gears_coefficients(locks: Any) -> Any:
        low, high = (1 - locks[0]) / 2, (1 + locks[1]) / 2
        return low + high, (low - high) * BACKLASH

    def neuron_coefficients(locks: Any) -> Any:
        low, high = (locks[0] + 1) / 2, (locks[1] + 1) / 2
        return 2.0 * low - 2.0 * high - 1.0, (1.0 + 2.0 * LOW) * high - 2.0 * LOW * low

    def chua_coefficients(locks: Any) -> Any:
        low, high = (locks[0] + 1) / 2, (locks[1] + 1) / 2
        return OUTER + (INNER - OUTER) * (low - high), (INNER - OUTER) * (
            low + high - 1.0
        )

    return [
        _problem("rocking_block", 12.0, (0.15, 0.0), (0.0,), block_slope,
                 lambda locks: (TILT * locks[0],), block_field, zero_guard),
        _problem("neuron", 60.0, (0.0, 0.0), (LOW, HIGH), neuron_slope, neuron_coefficients,
                 neuron_field, two_guards),
        _problem("chua", 5.0, (0.7, 0.0, 0.0), (-1.0, 1.0), chua_slope, chua_coefficients,
                 chua_field, two_guards),
        _problem("buck_converter", 6.0, (0.0, 0.0, 0.0, 1.0), (0.0,), converter_slope,
                 lambda locks: (SUPPLY * (1 - locks[0]) / 2,), converter_field, carrier_guard,
                 lambda _: lambda y, k: GAIN * (y[1] - WANTED) - y[2] + 0.0 * k),
        _problem("gears", 20.0, (0.0, 0.0, 0.0, 1.0), (-BACKLASH, BACKLASH), gears_slope,
                 gears_coefficients, gears_field, two_guards),
    ]  # fmt: skip


def _problem(
    name: str, end: float, y0: tuple[float, ...], places: tuple[float, ...],
    slope: Callable[[Any], Formula], coefficients: Formula, rates: Any, surfaces: Any,
    height: Callable[[Any], Formula] | None = None,
) -> Problem:  # fmt: skip
    at = np.array(places)
    names = tuple(f"guard{k}" for k in range(len(places)))
    system = System(rates, surfaces, n_states=len(y0), guard_names=names)
    return Problem(
        name, (0.0, end), y0, len(places), slope, height or (lambda _: lambda y, k: y[0] - at[k]),
        coefficients, system, places, tight_solution(system, (0.0, end), y0, places).y_end,
    )  # fmt: skip


def tight_solution(
    system: System,
    span: tuple[float, float],
    y0: tuple[float, ...],
    params: tuple[float, ...],
) -> Solution:
    """Return our solution at the tightest tolerance."""
    return solve(
        system, span, y0, params=params, rtol=SMALLEST_RTOL, atol=1e-15, method="dop853"
    )


def problems() -> list[Problem]:
    """Return all scenes."""
    return [octant_problem(), hopper_problem(), plate_problem(), *others()]


MODULES = {
    "SciPy": "scipy_peer",
    "SUNDIALS": "sundials_peer",
    "heyoka": "heyoka_peer",
    "diffrax": "diffrax_peer",
    "MuJoCo": "mujoco_peer",
}


def solvers_of(problem: Problem) -> tuple[list[Solver], dict[str, str]]:
    """Return all solvers of a scene, and the peers that are absent, with the reason."""
    found = our_solvers(problem)
    absent: dict[str, str] = {}
    for package, name in MODULES.items():
        try:
            found += import_module(f"peers.{name}").solvers(problem)
        except (ImportError, OSError, AttributeError) as error:
            absent[package] = str(error)
    return found, absent


METHODS = ("auto", "dopri5", "dop853", "taylor")
BATCH = 200


def our_solvers(problem: Problem) -> list[Solver]:
    """Return a solver for each method of `solve`, in single calls and in a batch."""
    forms = {"": problem.system} | {
        f", {name}": form for name, form in problem.forms.items()
    }
    ways = {"hopdata, call": (prepare, 1), "hopdata, batch": (prepare_batch, BATCH)}
    return [
        Solver(
            "hopdata",
            way,
            method + form,
            partial(prepared, problem, system, method),
            count,
        )
        for form, system in forms.items()
        for method in methods_for(system)
        for way, (prepared, count) in ways.items()
    ]


def methods_for(system: System) -> tuple[str, ...]:
    """Return the methods that support a system; Taylor's requires affine modes."""
    return tuple(
        method for method in METHODS if system.affine is not None or method != "taylor"
    )


def prepare(problem: Problem, system: System, method: str, tolerance: float) -> Run:
    """Return a function that makes one call."""
    system.compile(method)
    span, y0, params = problem.t_span, problem.y0, problem.params

    def run() -> Found:
        solution = solve(
            system,
            span,
            y0,
            params=params,
            rtol=tolerance,
            atol=tolerance,
            method=method,
        )
        if solution.status != 0:
            raise LostEventError(solution.message)
        return solution.y_end, solution.n_events

    return run


def prepare_batch(
    problem: Problem, system: System, method: str, tolerance: float
) -> Run:
    """Return a function that integrates a batch of copies of the trajectory on one thread."""
    system.compile(method)
    states, span, params = (
        np.tile(problem.start, (BATCH, 1)),
        problem.t_span,
        problem.params,
    )

    def run() -> Found:
        batch = solve_batch(
            system, span, states, params=params, rtol=tolerance, atol=tolerance, method=method,
            workers=1,
        )  # fmt: skip
        return batch.y_end[-1], int(batch.n_events[-1])

    return run
