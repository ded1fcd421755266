"""The integration method as the dissertation prints it (chapter IV), in plain NumPy.

It is a reference for `hopdata.hybrid.solve`, not a faster method. A classical solver
runs until an event function has changed sign between two points of its mesh
(`integrate`). The events on that step are then resolved on cubic Hermite splines,
followed by a third-order step to its end (`resolve_contacts`).

Corrections: slopes are refreshed after each crossing; locks are kept from step to step
instead of being read from signs again; a guard at zero has the lock that its rate leads
to; a guard that is at or beyond zero at the start of a step without having been crossed
is crossed there. Limits that remain: the step after an event has no error control, and
signs are compared on the mesh alone.

Any function that fits `ClassicalSolver` can serve as the classical solver. `Stepping`
makes one from a class with the interface of `scipy.integrate.OdeSolver`: RK45 (Dormand
and Prince's pair, the solver of section 4.4.1), DOP853, Radau, LSODA.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import acos, cbrt, copysign, cos, pi, sqrt
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import EventLog, System
from hopdata.hybrid.arguments import check_shape

Slope = Callable[[float, FloatArray], FloatArray]
Stop = Callable[[float, FloatArray], bool]


@dataclass(frozen=True)
class Mesh:
    """Points of a trajectory: times (N,), s, and states (N, n); the first is the start."""

    t: FloatArray
    y: FloatArray


class ClassicalSolver(Protocol):
    """Integrate `slope` from (t, y) to `t_end`, or to the first mesh point where `stop` holds.

    The start itself is not tested. The solver takes at least one step, and its method
    should be of third order or higher.
    """

    def __call__(
        self, slope: Slope, t: float, y: FloatArray, t_end: float, stop: Stop
    ) -> Mesh:
        """Return the mesh, including its start."""


class Stepper(Protocol):
    """The part of `scipy.integrate.OdeSolver` that `Stepping` uses."""

    t: float
    y: FloatArray
    status: str

    def step(self) -> str | None:
        """Take one step; `status` becomes "finished" at the end of the span, or "failed"."""


@dataclass(frozen=True)
class Stepping:
    """A classical solver made of a class of steppers.

    Parameters
    ----------
    kind : callable
        Called as ``kind(slope, t, y, t_end, **options)``, it returns a `Stepper`.
    options : mapping
        Options such as rtol, atol, max_step and first_step; the last is shortened if
        less time is left.
    """

    kind: Callable[..., Stepper]
    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(
        self, slope: Slope, t: float, y: FloatArray, t_end: float, stop: Stop
    ) -> Mesh:
        """Step until `stop` holds or the time is up; raise ArithmeticError if a step fails."""

        def rates(time: float, state: FloatArray) -> FloatArray:
            rate = slope(time, state)
            if not np.isfinite(
                rate
            ).all():  # otherwise it would retry a step size of NaN for ever
                raise ArithmeticError(
                    f"the classical solver failed at t = {time}: not finite"
                )
            return rate

        stepper = self.kind(rates, t, y, t_end, **self._within(t_end - t))
        times, states = [t], [y]
        while stepper.status == "running":
            message = stepper.step()
            if stepper.status == "failed":
                raise ArithmeticError(
                    f"the classical solver failed at t = {stepper.t}: {message}"
                )
            times.append(float(stepper.t))
            states.append(np.array(stepper.y, dtype=np.float64))
            if stop(times[-1], states[-1]):
                break
        return Mesh(np.array(times), np.array(states))

    def _within(self, left: float) -> Mapping[str, Any]:
        first = self.options.get("first_step")
        return (
            self.options
            if first is None
            else {**self.options, "first_step": min(first, left)}
        )


# Choices within the printed method.

ROOT_FINDERS = ("illinois", "cubic")


@dataclass(frozen=True)
class PrintedOptions:
    """Choices within Algorithms 5 and 6.

    Parameters
    ----------
    root_finder : str
        Root of a Hermite spline: ``"illinois"``, as section 4.3.3 recommends, or
        ``"cubic"``, the closed form that section 4.4.1 says was used.
    refresh_slopes : bool
        Whether the slopes at both ends of the step are evaluated again after each
        crossing. False follows Algorithm 5 to the letter, which sets them once, so that
        later events of the step are interpolated with slopes of a mode that has ended.
        For the record only.
    """

    root_finder: str = "illinois"
    refresh_slopes: bool = True

    def __post_init__(self) -> None:
        if self.root_finder not in ROOT_FINDERS:
            raise ValueError(
                f"root_finder: expected one of {', '.join(ROOT_FINDERS)}, found {self.root_finder}"
            )


# One event-selected region of a system, in which every event function rises through
# zero once.


@dataclass(frozen=True)
class Region:
    """A system near one corner of its guards; b_k = -1 before guard k is crossed, +1 after.

    Parameters
    ----------
    system : System
        Its field and guards are called as plain Python.
    params : (p,) array
        Parameters passed to them.
    orientation : (m,) array of int
        +1 if the event function of the region is h_k, -1 if it is -h_k because h_k
        falls.
    """

    system: System
    params: FloatArray
    orientation: IntArray

    def mode(self, locks: IntArray) -> IntArray:
        """Return the system's mode for the region's locks."""
        mode = np.zeros(self.system.n_modes, dtype=np.int64)
        mode[: self.system.n_guards] = self.orientation * locks
        return mode

    def slope(self, t: float, y: FloatArray, locks: IntArray) -> FloatArray:
        """Return the field (n,) with the locks held."""
        return self.slope_in(locks)(t, y)

    def slope_in(self, locks: IntArray) -> Slope:
        """Return the field with these locks held, as a function of time and state."""
        mode, field = self.mode(locks), self.system.field.function

        def slope(t: float, y: FloatArray) -> FloatArray:
            dy = np.zeros(len(y))
            field(t, y, mode, self.params, dy)
            return dy

        return slope

    def events(
        self, t: float, y: FloatArray, dy: FloatArray, locks: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return event functions (m,) and their rates (m,) along dy, 1/s, both oriented."""
        h, rates = np.zeros((2, self.system.n_guards))
        if self.system.guards is not None:
            self.system.guards.function(
                t, y, dy, self.mode(locks), self.params, h, rates
            )
        return self.orientation * h, self.orientation * rates

    def crossed(self, t: float, y: FloatArray, locks: IntArray) -> IntArray:
        """Return the candidates: guards with h >= 0 that are locked as not crossed."""
        h, _ = self.events(t, y, np.zeros(self.system.n_states), locks)
        return np.flatnonzero((locks < 0) & (h >= 0.0))

    def first_locks(self, t: float, y: FloatArray) -> IntArray:
        """Return the locks at a start: the sign of h, or the sign of its rate if h = 0.

        By the sign of h alone, a guard at zero would be neither before its event nor
        after it. A guard that rests at zero counts as not crossed.
        """
        before = -np.ones(self.system.n_guards, dtype=np.int64)
        h, _ = self.events(t, y, np.zeros(self.system.n_states), before)
        locks = np.where(h > 0.0, 1, before)
        if (h == 0.0).any():
            _, rates = self.events(t, y, self.slope(t, y, locks), locks)
            locks[(h == 0.0) & (rates > 0.0)] = 1
        return locks


def region_of(
    system: System, params: ArrayLike = (), *, orientation: Sequence[int] | None = None
) -> Region:
    """Return the region of a system in which its guards are crossed in the given directions.

    Parameters
    ----------
    system : System
        A system without a handler, because the printed method has no resets.
    params : (p,) array_like
        Parameters passed to its functions.
    orientation : sequence of int, optional
        +1 for each guard whose event function rises, -1 for each that falls. By default
        all rise.

    Raises
    ------
    ValueError
        If the system has a handler or has no single function for all guards, or if
        `orientation` is not one sign per guard.
    """
    if system.n_guards > 0 and system.guards is None:
        raise ValueError(
            "system: expected all event functions in one function, @guards"
        )
    if system.on_event is not None:
        raise ValueError(
            "system: the printed method does not call on_event; use hybrid.solve"
        )
    signs = (1,) * system.n_guards if orientation is None else tuple(orientation)
    if len(signs) != system.n_guards or not set(signs) <= {-1, 1}:
        raise ValueError(
            f"orientation: expected {system.n_guards} times -1 or +1, found {signs}"
        )
    numbers = np.array(params, dtype=np.float64).ravel()
    return Region(system, numbers, np.array(signs, dtype=np.int64))


# Cubic Hermite interpolation on one step (Hairer, Norsett, Wanner I, equation II.6.7).

Value = TypeVar("Value", float, NDArray[np.float64])


def hermite(
    theta: float, y0: Value, y1: Value, f0: Value, f1: Value, dt: float
) -> Value:
    """Return the cubic with values y0, y1 and slopes f0, f1 at the ends of a step.

    Parameters
    ----------
    theta : float
        Position in the step, 0 to 1.
    y0, y1 : float or (n,) array
        Values at the start and end of the step.
    f0, f1 : float or (n,) array
        Slopes at the start and end, per second.
    dt : float
        Length of the step, s.
    """
    rise = y1 - y0
    bend = (1.0 - 2.0 * theta) * rise + dt * ((theta - 1.0) * f0 + theta * f1)
    return (1.0 - theta) * y0 + theta * y1 + theta * (theta - 1.0) * bend


def coefficients(
    y0: Value, y1: Value, d0: Value, d1: Value
) -> tuple[Value, Value, Value, Value]:
    """Return the cubic's coefficients of 1, theta, theta^2, theta^3, from slopes per step."""
    rise = y1 - y0
    return y0, d0, 3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise


# Root on the unit interval of a cubic that is negative at its start and not negative at
# its end.

MOST_ITERATIONS = 100
SPACING = 2.0**-53
OUTSIDE = (
    1e-6  # how far rounding may put a root of the closed form outside the interval
)

Cubic = tuple[float, float, float, float]


def value(cubic: Cubic, x: float) -> float:
    """Return a + b x + c x^2 + d x^3."""
    a, b, c, d = cubic
    return a + x * (b + x * (c + x * d))


def derivative(cubic: Cubic, x: float) -> float:
    """Return b + 2 c x + 3 d x^2."""
    _, b, c, d = cubic
    return b + x * (2.0 * c + x * 3.0 * d)


def illinois(cubic: Cubic) -> float:
    """Return a root by the Illinois variant of regula falsi (Dowell and Jarratt 1971)."""
    return illinois_root(lambda x: value(cubic, x), 0.0, 1.0)


def illinois_root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return a root in [low, high], where `function` goes from negative to not negative.

    If an end is kept twice in a row, its value is halved, so that both ends close in.
    """
    f_low, f_high = function(low), function(high)
    if f_low >= 0.0:
        return low
    if f_high <= 0.0:
        return high
    kept = 0  # end kept by the last step: -1 for low, +1 for high
    for _ in range(MOST_ITERATIONS):
        x = (low * f_high - high * f_low) / (f_high - f_low)
        if not low < x < high:
            x = 0.5 * (low + high)
        fx = function(x)
        if fx == 0.0:
            return x
        if fx < 0.0:
            low, f_low, f_high = x, fx, 0.5 * f_high if kept > 0 else f_high
            kept = 1
        else:
            high, f_high, f_low = x, fx, 0.5 * f_low if kept < 0 else f_low
            kept = -1
        if high - low <= 2.0 * SPACING * high:
            break
    return high


def closed_form(cubic: Cubic) -> float:
    """Return the first root by Cardano's and Viete's formulas, refined by Newton steps.

    On a short step the cubic is nearly linear, so its leading coefficient is nearly
    zero. The formulas are then applied to the cubic of the reciprocal root, whose
    leading coefficient is not. Only roots where the cubic rises count: a guard that has
    just left zero has a falling root directly before the step.
    """
    a, b, c, d = cubic
    if abs(d) >= abs(a):
        roots = _monic_roots(c / d, b / d, a / d) if d != 0.0 else []
    else:
        reciprocal = _monic_roots(b / a, c / a, d / a)
        roots = [1.0 / x for x in reciprocal if x != 0.0]
    inside = [
        x
        for x in roots
        if -OUTSIDE <= x <= 1.0 + OUTSIDE and derivative(cubic, x) >= 0.0
    ]
    if not inside:
        return illinois(
            cubic
        )  # rounding moved all roots out: near an end, or nearly double
    return _polished(cubic, min(max(min(inside), 0.0), 1.0))


def _monic_roots(b: float, c: float, d: float) -> list[float]:
    """Return the real roots of x^3 + b x^2 + c x + d."""
    shift = b / 3.0
    p = c / 3.0 - shift * shift  # x = z - shift: z^3 + 3 p z + 2 q
    q = 0.5 * (2.0 * shift * shift * shift - shift * c + d)
    discriminant = q * q + p * p * p
    if discriminant < 0.0:
        radius = sqrt(-p)
        angle = acos(max(-1.0, min(1.0, q / (p * radius)))) / 3.0
        return [
            2.0 * radius * cos(angle - k * 2.0 * pi / 3.0) - shift for k in range(3)
        ]
    u = -cbrt(q + copysign(sqrt(discriminant), q))
    return [(u - p / u if u != 0.0 else 0.0) - shift]


def _polished(cubic: Cubic, x: float) -> float:
    """Take Newton steps within the interval while they reduce the size of the cubic."""
    residual = value(cubic, x)
    for _ in range(4):
        slope = derivative(cubic, x)
        new = min(max(x - residual / slope, 0.0), 1.0) if slope != 0.0 else x
        if abs(value(cubic, new)) >= abs(residual):
            break
        x, residual = new, value(cubic, new)
    return x


FINDERS: dict[str, Callable[[Cubic], float]] = {
    "illinois": illinois,
    "cubic": closed_form,
}


@dataclass(frozen=True)
class Crossing:
    """Crossing of a guard: instant, s, guard number, state (n,), and locks (m,) after it."""

    time: float
    guard: int
    state: FloatArray
    locks: IntArray


@dataclass(frozen=True)
class Resolution:
    """End of a step with events: state (n,), locks (m,), and the crossings in order."""

    y: FloatArray
    locks: IntArray
    crossings: tuple[Crossing, ...]


def resolve_contacts(
    region: Region,
    t0: float,
    y0: FloatArray,
    t1: float,
    y1: FloatArray,
    locks: IntArray,
    options: PrintedOptions | None = None,
) -> Resolution:
    """Integrate through all events between two points of a mesh (Algorithm 5).

    The guard whose spline has the earliest root is crossed first. The state there is
    interpolated, and one third-order step in the new mode leads to the end again. This
    repeats until no guard remains that has changed sign. That step has no error
    control: the caller bounds its length.

    Parameters
    ----------
    region : Region
        Field and event functions.
    t0, t1 : float
        Ends of the step, s.
    y0, y1 : (n,) array
        States at the ends; the second follows from the mode at the start.
    locks : (m,) array of int
        -1 for guards that are not crossed at t0, +1 for those that are.
    options : PrintedOptions, optional
        Root finder, and whether slopes are refreshed.

    Returns
    -------
    Resolution
        True state and locks at t1. There are at most m crossings, as each sets one lock
        for good.
    """
    options = options or PrintedOptions()
    locks = locks.copy()
    crossings: list[Crossing] = []
    kept = f0, f1 = region.slope(t0, y0, locks), region.slope(t1, y1, locks)
    candidates = region.crossed(t1, y1, locks)
    while len(candidates) > 0:
        dt = t1 - t0
        parts = impact_fractions(
            region, t0, y0, f0, t1, y1, f1, locks, candidates, options
        )
        first = int(np.argmin(parts))
        y0 = hermite(
            parts[first],
            y0,
            y1,
            *(kept if not options.refresh_slopes else (f0, f1)),
            dt,
        )
        t0 = t0 + parts[first] * dt
        locks[candidates[first]] = 1
        crossings.append(Crossing(t0, int(candidates[first]), y0, locks.copy()))
        f0 = region.slope(t0, y0, locks)
        y1 = heun3_step(region.slope_in(locks), t0, y0, f0, t1 - t0)
        f1 = region.slope(t1, y1, locks)
        candidates = region.crossed(t1, y1, locks)
    return Resolution(y1, locks, tuple(crossings))


def impact_fractions(
    region: Region,
    t0: float,
    y0: FloatArray,
    f0: FloatArray,
    t1: float,
    y1: FloatArray,
    f1: FloatArray,
    locks: IntArray,
    candidates: IntArray,
    options: PrintedOptions,
) -> list[float]:
    """Return where in the step each candidate is crossed, 0 to 1 (Algorithm 6).

    A candidate that is already at or beyond zero at the start has no bracket and is
    crossed there. This happens to guards that cross together when rounding moves one of
    them.
    """
    find, dt = FINDERS[options.root_finder], t1 - t0
    h0, rates0 = region.events(t0, y0, f0, locks)
    h1, rates1 = region.events(t1, y1, f1, locks)
    splines = coefficients(h0, h1, dt * rates0, dt * rates1)
    return [
        find(tuple(float(part[k]) for part in splines)) if h0[k] < 0.0 else 0.0  # type: ignore[arg-type]
        for k in candidates
    ]


def heun3_step(
    slope: Slope, t: float, y: FloatArray, f: FloatArray, dt: float
) -> FloatArray:
    """Return the state after one step of Heun's third-order method, whose first slope is f."""
    second = slope(t + dt / 3.0, y + dt / 3.0 * f)
    third = slope(t + 2.0 * dt / 3.0, y + 2.0 * dt / 3.0 * second)
    return y + 0.25 * dt * (f + 3.0 * third)


@dataclass(frozen=True)
class PrintedSolution:
    """A trajectory with the attributes of `hopdata.hybrid.Solution`.

    Parameters
    ----------
    t : (N,) array
        Times of the mesh, s, including the instants of events.
    y : (n, N) array
        States at these times.
    events : EventLog
        All events.
    mode : (m,) array of int
        Mode at the end.
    """

    t: FloatArray
    y: FloatArray
    events: EventLog
    mode: IntArray

    @property
    def t_end(self) -> float:
        """Time reached, s."""
        return float(self.t[-1])

    @property
    def y_end(self) -> FloatArray:
        """State reached, (n,)."""
        return self.y[:, -1]


def integrate(
    region: Region,
    t_span: tuple[float, float],
    y0: ArrayLike,
    *,
    solver: ClassicalSolver | None = None,
    options: PrintedOptions | None = None,
    ended: Stop | None = None,
) -> PrintedSolution:
    """Integrate within one region, in which each guard is crossed at most once (section 4.3).

    Parameters
    ----------
    region : Region
        Field and event functions, from `region_of`.
    t_span : tuple of float
        Start and end, s.
    y0 : (n,) array_like
        Initial state.
    solver : ClassicalSolver, optional
        By default `Stepping` with scipy's `RK45`. Set a `max_step`: a sign that changes
        twice between two mesh points goes unnoticed, and the step after an event has no
        error control.
    options : PrintedOptions, optional
        Choices within the method.
    ended : callable, optional
        ``ended(t, y) -> bool``: stop at the first mesh point after the start where it
        is true.

    Returns
    -------
    PrintedSolution
        Mesh and events.

    Raises
    ------
    ArithmeticError
        If the classical solver fails, or returns without having advanced.
    """
    if solver is None:
        from scipy.integrate import RK45

        solver = Stepping(RK45)
    t_start = float(t_span[0])
    y = check_shape("y0", y0, region.system.n_states)
    locks, t, t_end = region.first_locks(t_start, y), t_start, float(t_span[1])
    meshes, done = [Mesh(np.array([t]), y[None])], False
    crossings: list[Crossing] = []
    while t < t_end and not done:
        leg, resolved = _one_leg(region, solver, t, y, t_end, locks, options, ended)
        meshes.append(leg)
        crossings.extend(resolved.crossings)
        t, y, locks = float(leg.t[-1]), leg.y[-1], resolved.locks
        done = ended is not None and ended(t, y)
    joined = Mesh(
        *(np.concatenate([getattr(m, part) for m in meshes]) for part in ("t", "y"))
    )
    log = event_log(region, crossings)
    return PrintedSolution(joined.t, joined.y.T.copy(), log, region.mode(locks))


def _one_leg(
    region: Region,
    solver: ClassicalSolver,
    t: float,
    y: FloatArray,
    t_end: float,
    locks: IntArray,
    options: PrintedOptions | None,
    ended: Stop | None,
) -> tuple[Mesh, Resolution]:
    """Run the solver in one mode until it stops, and resolve its last step; exclude the start."""

    def stop(time: float, state: FloatArray) -> bool:
        crossed = len(region.crossed(time, state, locks)) > 0
        return crossed or (ended is not None and ended(time, state))

    mesh = solver(region.slope_in(locks), t, y, t_end, stop)
    if len(mesh.t) < 2 or not mesh.t[-1] > t:
        raise ArithmeticError(f"the classical solver did not advance from t = {t}")
    if len(region.crossed(mesh.t[-1], mesh.y[-1], locks)) == 0:
        return Mesh(mesh.t[1:], mesh.y[1:]), Resolution(mesh.y[-1], locks, ())
    (t0, t1), (y0, y1) = mesh.t[-2:], mesh.y[-2:]
    resolved = resolve_contacts(region, float(t0), y0, float(t1), y1, locks, options)
    times = [*mesh.t[1:-1], *(one.time for one in resolved.crossings), t1]
    states = [*mesh.y[1:-1], *(one.state for one in resolved.crossings), resolved.y]
    return Mesh(np.array(times), np.array(states)), resolved


def event_log(region: Region, crossings: Sequence[Crossing]) -> EventLog:
    """Return crossings as the library's event log; without resets, before equals after."""
    guards = [one.guard for one in crossings]
    n, n_modes = region.system.n_states, region.system.n_modes
    modes = [region.mode(one.locks) for one in crossings]
    states = np.array([one.state for one in crossings]).reshape(-1, n)
    return EventLog.of_columns(
        time=np.array([one.time for one in crossings]),
        guard=np.array(guards, dtype=np.int64),
        direction=region.orientation[guards],
        before=states,
        after=states,
        mode=np.array(modes, dtype=np.int64).reshape(-1, n_modes),
        guard_names=region.system.guard_names,
    )
