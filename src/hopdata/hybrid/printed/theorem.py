"""Theorem 4.2.1 in numbers: the error of one localised event, and its proven bound.

On a step of length dt with one event at t*, let p be the Hermite cubic through states
and slopes at its ends, and t' the root of the Hermite cubic of the event function.
Then::

    |t' - t*| <= (L / 24 + L_h K) / c dt^4,
    |p(t') - y(t*)| <= ((L / 24 + L_h K) / c L_p + K) dt^4

in the largest component, with the constants of table 4.1. They are suprema or infima
over the step; here they are computed for polynomials and for the known solution on a
fine grid that includes both ends. The table defines L with the true solution in words
and with g = h(p) in symbols; the proof needs h along p, which is used here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from hopdata.arrays import FloatArray
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.printed.one_step import dopri5_step, heun3_step
from hopdata.hybrid.printed.order import OneStep
from hopdata.hybrid.printed.roots import illinois
from hopdata.hybrid.printed.spline import coefficients, hermite


@dataclass(frozen=True)
class KnownEvent:
    """A trajectory in closed form, and a quadratic event function that it crosses.

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
    time = 0.7
    hessian = np.array([[0.6, 0.2, 0.0], [0.2, -0.4, 0.3], [0.0, 0.3, 0.5]])
    gradient = np.array([-0.3, 1.5, -0.4])
    y = turning_derivative(0, np.array(time))
    # So that h is zero at that time.
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


# Method that leads to the second point of the mesh; "exact": it lies on the solution.
ONE_STEP: dict[str, OneStep | None] = {
    "exact": None,
    "dopri5": dopri5_step,
    "heun3": heun3_step,
}
MESHES = tuple(ONE_STEP)
#: Points of a step at which suprema and infima are taken, both ends among them.
#: Unit: 1. Origin: chosen.
GRID = 513
#: Largest error of a Hermite cubic over its function's fourth derivative.
#: Unit: 1. Origin: derived: the maximum of theta^2 (1 - theta)^2 / 4!.
LARGEST_FOURTH = 1 / 384
#: Largest effect of a wrong slope at the end of a step.
#: Unit: 1. Origin: derived: the maximum of theta^2 (1 - theta).
LARGEST_SLOPE_BASIS = 4 / 27

Ends = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class Constants:
    """Constants of table 4.1: L is `fourth`, K `spline`, c `liveness`, L_p `speed`."""

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
    """Errors in time, s, and state of one event, with its step and constants."""

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
    """Localise an event on one step as Algorithms 5 and 6 do, with the proven bounds.

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
    found_time = start + root * dt
    found_state = hermite(root, *ends, dt)
    true_state = event.derivative(0, np.array(event.time))
    return Localisation(
        dt=dt,
        time_error=abs(found_time - event.time),
        state_error=float(np.abs(found_state - true_state).max()),
        constants=constants(event, start, dt, ends),
    )


def mesh_ends(event: KnownEvent, start: float, dt: float, mesh: str) -> Ends:
    """Return states and slopes (y0, y1, f0, f1) at both ends of a step."""
    expect(mesh in ONE_STEP, "mesh", f"one of {', '.join(MESHES)}", mesh)
    one_step = ONE_STEP[mesh]
    y0 = event.derivative(0, np.array(start))
    f0 = event.slope(start, y0)
    if one_step is None:
        y1 = event.derivative(0, np.array(start + dt))
    else:
        y1 = one_step(event.slope, start, y0, dt)
    return y0, y1, f0, event.slope(start + dt, y1)


def constants(event: KnownEvent, start: float, dt: float, ends: Ends) -> Constants:
    """Return the constants of table 4.1 on the step from `start` with these ends."""
    theta = np.linspace(0.0, 1.0, GRID)
    times = start + dt * theta
    y = event.derivative(0, times)
    dy = event.derivative(1, times)
    gradients = event.hessian @ y + event.gradient[:, None]
    rates = np.einsum("it,it->t", gradients, dy)
    live = rates.min() > 0.0
    expect(live, "dt", "an event function that is live on the whole step", f"{dt:g}")
    # Derivatives by theta become those by time with a factor 1 / dt each.
    p = spline_polynomials(ends, dt)
    along = np.array([one(theta) for one in p])
    fourth = _height_along(event, p).deriv(4)(theta)
    speeds = [float(np.abs(one.deriv()(theta)).max()) for one in p]
    return Constants(
        fourth=float(np.abs(fourth).max()) / dt**4,
        lipschitz=_lipschitz(event, np.concatenate([y, along], axis=1)),
        spline=_spline_constant(event, start, dt, ends, times),
        liveness=float(rates.min()),
        speed=max(speeds) / dt,
    )


def spline_polynomials(ends: Ends, dt: float) -> list[Polynomial]:
    """Return the Hermite cubic of each component as a polynomial in theta."""
    y0, y1, f0, f1 = ends
    of_powers = coefficients(y0, y1, dt * f0, dt * f1)
    return [Polynomial(row) for row in np.transpose(of_powers)]


def _root(event: KnownEvent, ends: Ends, dt: float) -> float:
    """Return theta of the root of the Hermite cubic of the event function."""
    y0, y1, f0, f1 = ends
    heights = (event.height(y0), event.height(y1))
    slopes = (dt * event.rate(y0, f0), dt * event.rate(y1, f1))
    return illinois(coefficients(*heights, *slopes))


def _height_along(event: KnownEvent, p: list[Polynomial]) -> Polynomial:
    """Return h along the spline, g = h(p), a polynomial of degree six in theta."""
    linear = Polynomial([0.0])
    for weight, one in zip(event.gradient, p, strict=True):
        linear = linear + weight * one
    quadratic = Polynomial([event.offset])
    for i, j in np.ndindex(event.hessian.shape):
        quadratic = quadratic + 0.5 * event.hessian[i, j] * p[i] * p[j]
    return linear + quadratic


def _lipschitz(event: KnownEvent, points: FloatArray) -> float:
    """Return a Lipschitz constant of h, in the largest component, on points' box."""
    low = points.min(axis=1)
    high = points.max(axis=1)
    # The gradient of h in the middle of the box, and how far it may be from that.
    middle = event.hessian @ (0.5 * (low + high)) + event.gradient
    around = np.abs(event.hessian) @ (0.5 * (high - low))
    return float((np.abs(middle) + around).sum())


def _spline_constant(
    event: KnownEvent, start: float, dt: float, ends: Ends, times: FloatArray
) -> float:
    """Return K: of the exact Hermite cubic, and of errors at the step's end."""
    _, y1, _, f1 = ends
    end = np.array(start + dt)
    off = np.abs(y1 - event.derivative(0, end)).max()
    slope_off = np.abs(f1 - event.derivative(1, end)).max()
    fourth = np.abs(event.derivative(4, times)).max()
    of_end = (off + LARGEST_SLOPE_BASIS * dt * slope_off) / dt**4
    return float(LARGEST_FOURTH * fourth + of_end)
