"""Theorem 4.2.1 in numbers: the error of one localised event, and the bound proven for it.

On a step of length dt with one event at t*, let p be the Hermite cubic through states and slopes at
its ends, and t' the root of the Hermite cubic of the event function. Then

    |t' - t*| <= (L / 24 + L_h K) / c dt^4,   |p(t') - y(t*)| <= ((L / 24 + L_h K) / c L_p + K) dt^4

in the largest component, with the constants of table 4.1. All of them are suprema or infima over
the step; here those of polynomials and of the known solution on a fine grid with both ends.
The table's words for L name the true solution; the proof needs, and this module takes, h along p.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from hopdata.hybrid.printed.classical import Slope, dopri5_step
from hopdata.hybrid.printed.contacts import coefficients, hermite, heun3_step, illinois
from hopdata.hybrid.solution import FloatArray

# An event on a trajectory that is known in closed form, to measure errors against.


@dataclass(frozen=True)
class KnownEvent:
    """A trajectory known in closed form, and a quadratic event function that it crosses.

    Parameters
    ----------
    slope : callable
        Field ``slope(t, y) -> (n,)``.
    derivative : callable
        ``derivative(k, t) -> (n, ...)``: k-th derivative of the solution at times t (...).
    hessian : (n, n) array
        Symmetric H of h(y) = y H y / 2 + gradient y + offset.
    gradient : (n,) array
        See there.
    offset : float
        See there.
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
    """Return a point on a helix that closes in on a plane, and a paraboloid that it crosses."""
    time, instant = 0.7, np.array(0.7)
    hessian = np.array([[0.6, 0.2, 0.0], [0.2, -0.4, 0.3], [0.0, 0.3, 0.5]])
    gradient = np.array([-0.3, 1.5, -0.4])
    y = turning_derivative(0, instant)
    offset = -float(0.5 * y @ hessian @ y + gradient @ y)
    return KnownEvent(turning_slope, turning_derivative, hessian, gradient, offset, time)


def turning_slope(_: float, y: FloatArray) -> FloatArray:
    """Return the field of the helix: a rotation of two components, the decay of the third."""
    return np.array([-y[1], y[0], -y[2]])


def turning_derivative(k: int, t: FloatArray) -> FloatArray:
    """Return the k-th derivative (3, ...) of (cos t, sin t, exp(-t))."""
    turned = t + k * np.pi / 2
    return np.array([np.cos(turned), np.sin(turned), (-1) ** k * np.exp(-t)])


MESHES = ("exact", "dopri5", "heun3")
GRID = 513
LARGEST_FOURTH = 1 / 384  # of theta^2 (1 - theta)^2 / 4!
LARGEST_SLOPE_BASIS = 4 / 27  # of theta^2 (1 - theta)

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
    """Errors of one event: of its time, s, and of its state, with the step and the constants."""

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
    """Localise an event on one step as Algorithms 5 and 6 do, and compute what is proven of it.

    Parameters
    ----------
    event : KnownEvent
        Solution and event function.
    dt : float
        Length of the step, s.
    part : float
        Where in the step the event lies, 0 to 1.
    mesh : str
        ``"exact"``: both ends lie on the solution; ``"dopri5"``, ``"heun3"``: the second is where
        one step of Dormand-Prince, or of Heun's third-order method, leads from the first.
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


def dopri5_end(slope: Slope, t: float, y: FloatArray, f: FloatArray, dt: float) -> FloatArray:
    """Return the state after one step of Dormand-Prince."""
    return dopri5_step(slope, t, y, f, dt)[0]


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
    return [Polynomial(row) for row in np.transpose(coefficients(y0, y1, dt * f0, dt * f1))]


def _root(event: KnownEvent, ends: Ends, dt: float) -> float:
    y0, y1, f0, f1 = ends
    slopes = dt * event.rate(y0, f0), dt * event.rate(y1, f1)
    return illinois(coefficients(event.height(y0), event.height(y1), *slopes))


def _height_along(event: KnownEvent, p: list[Polynomial]) -> Polynomial:
    """Return h of the spline, g = h(p), a polynomial of degree six in theta."""
    linear = sum((q * one for q, one in zip(event.gradient, p, strict=True)), Polynomial([0.0]))
    products = (
        0.5 * event.hessian[i, j] * p[i] * p[j] for i in range(len(p)) for j in range(len(p))
    )
    return linear + sum(products, Polynomial([event.offset]))


def _lipschitz(event: KnownEvent, points: FloatArray) -> float:
    """Return a Lipschitz constant of h, in the largest component, on the box around points."""
    low, high = points.min(axis=1), points.max(axis=1)
    middle = event.hessian @ (0.5 * (low + high)) + event.gradient
    return float((np.abs(middle) + np.abs(event.hessian) @ (0.5 * (high - low))).sum())


def _spline_constant(
    event: KnownEvent, start: float, dt: float, ends: Ends, times: FloatArray
) -> float:
    """Return K: of the exact Hermite cubic, and what errors of the step's end add to it."""
    _, y1, _, f1 = ends
    end = np.array(start + dt)
    off = np.abs(y1 - event.derivative(0, end)).max()
    slope_off = np.abs(f1 - event.derivative(1, end)).max()
    fourth = np.abs(event.derivative(4, times)).max()
    return float(LARGEST_FOURTH * fourth + (off + LARGEST_SLOPE_BASIS * dt * slope_off) / dt**4)
