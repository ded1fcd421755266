"""A Kalman filter through contacts: its covariance passes events by saltation matrices.

An extended Kalman filter needs the derivative of the flow. Where a trajectory meets a
guard, a neighbour meets it earlier or later, and so has the field of the other mode for
a longer or shorter time. The saltation matrix is this effect's derivative; the filter
that includes it is Kong, Payne, Council and Johnson's salted Kalman filter (2021;
"[Kon+21]" of the dissertation, section 1.2). Without it, the uncertainty of the time of
contact never reaches the velocities.

A measurement may also move the mean across a guard's surface: the contact that was
predicted has not occurred yet, or one has that was not predicted. Then the estimate is
taken to the other mode by the same first-order map.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.first_order import linearise as local
from hopdata.hybrid.first_order.linearise import Instant
from hopdata.hybrid.first_order.segments import derivative_without_saltation
from hopdata.hybrid.solve import solve
from hopdata.hybrid.system import System


@dataclass(frozen=True)
class Estimate:
    """What a filter knows at one time.

    Parameters
    ----------
    t : float
        Time, s.
    mean : (n,) array
        Estimated state.
    covariance : (n, n) array
        Covariance of the state's error.
    mode : (m,) array of int
        Mode of the estimated state, with all locks set.
    """

    t: float
    mean: FloatArray
    covariance: FloatArray
    mode: IntArray

    def normalised_error(self, truth: ArrayLike) -> float:
        """Return the normalised squared error (NEES), e' P^-1 e.

        Its expectation is the number of states n if the covariance is that of the
        errors, and larger if the filter is more confident than it may be.
        """
        error = np.asarray(truth, dtype=np.float64) - self.mean
        return float(error @ np.linalg.solve(self.covariance, error))


class SaltationFilter:
    """An extended Kalman filter of an event-selected system.

    Parameters
    ----------
    system : System
        Field, guards and handler.
    params : (p,) array_like
        Numbers handed to the system's functions.
    noise_density : (n, n) array_like, optional
        Covariance that the process noise adds per unit of time. By default none.
    scale : (n,) array_like, optional
        Size of each coordinate, which scales difference steps. By default 1.
    saltation : bool
        Whether the covariance passes events by their saltation matrices. False is for
        comparison: the covariance then follows the field from event to event, as if
        events came at fixed times.
    **options
        Options of `solve`, such as `rtol`.

    Examples
    --------
    >>> from hopdata.hybrid import field, guards
    >>> @field
    ... def drop(t, y, mode, params, dy):
    ...     dy[0] = y[1]
    ...     dy[1] = -10.0
    ...     if mode[0] > 0:
    ...         dy[1] += 30.0
    >>> @guards
    ... def ground(t, y, dy, mode, params, h, hdot):
    ...     h[0] = -y[0]
    ...     hdot[0] = -dy[0]
    >>> system = System(drop, ground, n_states=2, guard_names=("ground",))
    >>> known = np.diag([0.01**2, 1e-12])
    >>> start = Estimate(0.0, np.array([0.1, -2.0]), known, np.array([-1]))
    >>> for saltation in (True, False):
    ...     one = SaltationFilter(system, saltation=saltation)
    ...     print(one.predict(start, 0.1).covariance[1, 1].round(4))
    0.015
    0.0
    """

    def __init__(
        self,
        system: System,
        *,
        params: ArrayLike = (),
        noise_density: ArrayLike | None = None,
        scale: ArrayLike | None = None,
        saltation: bool = True,
        **options: Any,
    ) -> None:
        n = system.n_states
        density = np.zeros((n, n))
        if noise_density is not None:
            density = np.asarray(noise_density, dtype=np.float64)
        expect(density.shape == (n, n), "noise_density", f"({n}, {n})", density.shape)
        self.system = system
        self.params = np.array(params, dtype=np.float64).ravel()
        self.noise_density = density
        self.scale = local.state_scale(system, scale)
        self.saltation = saltation
        self.options = options

    def predict(self, estimate: Estimate, t: float) -> Estimate:
        """Return the estimate at a later time, through all events until then.

        An event that ends an integration (`terminal`, or the handler returned 1) does
        not end the prediction, which goes on from there.

        Raises
        ------
        ValueError
            If the time is before that of the estimate, or the integrator fails, with
            its message.
        """
        expect(t >= estimate.t, "t", f"a time from {estimate.t:g} on", t)
        now = estimate
        while now.t < t:
            now = self._until_stopped(now, t)
        added = self.noise_density * (t - estimate.t)
        return replace(now, covariance=now.covariance + added)

    def _until_stopped(self, start: Estimate, t: float) -> Estimate:
        """Return the prediction at time t, or where an event ends the integration."""
        request: dict[str, Any] = {
            "params": self.params,
            "mode": start.mode.tolist(),
            **self.options,
        }
        span = (start.t, t)
        if self.saltation:
            solution = solve(self.system, span, start.mean, jacobian=True, **request)
            flow = solution.jacobian
        else:
            solution, flow, _ = derivative_without_saltation(
                self.system, span, start.mean, **request
            )
        goes_on = solution.success and solution.t_end > start.t
        expect(
            goes_on and flow is not None, "t", "a solution up to it", solution.message
        )
        assert flow is not None
        covariance = flow @ start.covariance @ flow.T
        return Estimate(solution.t_end, solution.y_end, covariance, solution.mode)

    def update(
        self,
        estimate: Estimate,
        measured: ArrayLike,
        observation: ArrayLike,
        noise: ArrayLike,
    ) -> Estimate:
        """Return the estimate after a measurement.

        Parameters
        ----------
        estimate : Estimate
            The prediction at the time of the measurement.
        measured : (k,) array_like
            What was measured.
        observation : (k, n) array_like
            Derivative of what is measured with respect to the state.
        noise : (k, k) array_like
            Covariance of the measurement's noise.
        """
        h = np.asarray(observation, dtype=np.float64)
        r = np.asarray(noise, dtype=np.float64)
        surprise = np.asarray(measured, dtype=np.float64) - h @ estimate.mean
        p = estimate.covariance
        gain = np.linalg.solve(h @ p @ h.T + r, h @ p).T
        kept = np.eye(len(p)) - gain @ h
        # Joseph's form, which keeps the covariance symmetric and positive.
        covariance = kept @ p @ kept.T + gain @ r @ gain.T
        updated = replace(
            estimate, mean=estimate.mean + gain @ surprise, covariance=covariance
        )
        return self._in_its_mode(updated)

    def _in_its_mode(self, estimate: Estimate) -> Estimate:
        """Return the estimate in the mode whose side of the guards its mean is on."""
        for guard in range(self.system.n_guards):
            at = Instant(estimate.t, estimate.mean, estimate.mode, self.params)
            h = local.guards_at(self.system, at, np.zeros(len(at.y)))[0]
            if at.mode[guard] * h[guard] < 0:
                estimate = self._taken_across(estimate, at, guard, float(h[guard]))
        return estimate

    def _taken_across(
        self, estimate: Estimate, at: Instant, guard: int, h: float
    ) -> Estimate:
        """Return the estimate in the mode on the other side of a guard.

        The mean has been in the wrong mode since it was at the surface, a time h over
        its rate ago (or, if this is negative, it will be there only then). For this
        time it should have had the other field. It stays as it is if its guard stands
        still, or if the mode beyond puts it on the near side again.
        """
        here = local.linearise(self.system, at, self.scale)
        rate = float(here.guard_rates[guard])
        if rate == 0:
            return estimate
        beyond = local.cross(self.system, at, guard)
        there = local.linearise(self.system, beyond, self.scale)
        change = there.rate - here.rate
        mean = beyond.y + change * h / rate
        moved = beyond.moved(mean, at.t)
        after = local.guards_at(self.system, moved, np.zeros(len(mean)))[0]
        if moved.mode[guard] * after[guard] < 0:
            return estimate
        covariance = estimate.covariance
        if self.saltation:
            salted = np.eye(len(mean)) + np.outer(change, here.gradients[guard]) / rate
            covariance = salted @ covariance @ salted.T
        return Estimate(estimate.t, mean, covariance, beyond.mode)


def confidence_limit(n_states: int, *, share: float = 0.95) -> float:
    """Return the normalised error below which a consistent filter's is, in this share.

    The normalised squared error of n states is chi-squared with n degrees of freedom;
    its quantile is that of Wilson and Hilferty's normal approximation, right to 1.5 %
    for shares from 0.5 to 0.99 and two degrees or more.

    Parameters
    ----------
    n_states : int
        Number of states, which is also the expectation of the normalised error.
    share : float
        Share of the errors that are below, 0 to 1.
    """
    spread = 2.0 / (9.0 * n_states)
    deviations = NormalDist().inv_cdf(share)
    return float(n_states * (1.0 - spread + deviations * spread**0.5) ** 3)
