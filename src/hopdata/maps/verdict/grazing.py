"""Whether landings graze the post section, as far as the states alone can tell.

A body that hardly falls at the post section crosses it at an instant that depends on
the state like a square root: on the section, its squared vertical speed is what is left
of the energy of the fall. If the scatter of the squared speed comes near its mean, the
map from state to state bends there by more than smooth terms can follow, and what they
leave looks like a difference between contact orders. A C1 body whose section lay among
its lowest points was called "different by 22 %".

The squared speed is as smooth a function of the state as the landing is; the speed is
its root. So what smooth terms leave of the root, over the squared speeds that occur, is
the share of the map's derivative that is *bent*. On bodies that share no code with ours
it was 0.001 to 0.005 with sections 50 to 70 mm below the contact, and 0.11 where a C1
body was called different.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.given import numbers

#: Terms of the smooth map that a bend is held against.
#: Unit: 1. Origin: derived: the verdict's smooth terms are cubic.
SMOOTH_DEGREE = 3

#: Quantiles of the squared speed between which a bend is taken: beyond them, single
#: landings would decide.
#: Unit: 1. Origin: chosen.
INNER = (0.01, 0.99)

#: If more than this share of the landings rise at the section, it is none that bodies
#: fall through, and nothing can be said of how they pass it.
#: Unit: 1. Origin: chosen: noise of the speeds makes a few rise.
MOST_RISING = 0.1

#: Fewest landings of which a bend is told.
#: Unit: landings. Origin: chosen.
LEAST_LANDINGS = 20


@dataclass(frozen=True)
class Grazing:
    """How the landings of a study pass the post section.

    Attributes
    ----------
    usual_time_per_height, large_time_per_height
        Median over the landings, and 95 % quantile, of one over the vertical speed: how
        much an error in height shifts the instant of the passage. In the unit of the
        states; infinite if the body rises.
    scatter
        Standard deviation of the squared vertical speed, as a share of its mean.
    bent
        Share of the map's derivative into the vertical speed that smooth terms leave,
        as the root mean square over the landings; 0 if more than `MOST_RISING` rise.
    rising
        Share of the landings that do not fall at the section.
    """

    usual_time_per_height: float
    large_time_per_height: float
    scatter: float
    bent: float
    rising: float


def grazing(y: ArrayLike) -> Grazing:
    """Return how landings pass the post section.

    Parameters
    ----------
    y
        (n, 6B) states at the post section, as `hopdata.maps.verdict.judge` takes them:
        positions of B markers, then velocities, z up. Landings with NaN are left out.

    Raises
    ------
    AnalysisError
        If the shape does not match, or fewer than `LEAST_LANDINGS` are known.
    """
    states = numbers("y", y)
    if states.ndim != 2 or states.shape[1] == 0 or states.shape[1] % 6 != 0:
        raise AnalysisError.at("y", "one row per landing, (n, 6B)", f"{states.shape}")
    known = states[np.isfinite(states).all(axis=1)]
    if len(known) < LEAST_LANDINGS:
        expected = f"at least {LEAST_LANDINGS} landings"
        raise AnalysisError.at("y", expected, f"{len(known)}")
    half = known.shape[1] // 2
    fall = -known[:, half + 2 :: 3].mean(axis=1)
    squared = fall**2
    rising = float(np.mean(fall <= 0))
    bent = 0.0
    if rising <= MOST_RISING:
        bent = bent_share(squared)
    return Grazing(
        usual_time_per_height=_one_over(float(np.median(fall))),
        large_time_per_height=_one_over(float(np.quantile(fall, 0.05))),
        scatter=float(squared.std() / squared.mean()),
        bent=bent,
        rising=rising,
    )


def bent_share(squared_speed: FloatArray) -> float:
    """Return the share of the derivative of the root that smooth terms leave.

    The root of the squared speed (n,) is fitted by a polynomial of `SMOOTH_DEGREE`.
    Returned is the rms difference of the two derivatives over the rms derivative.
    """
    low, high = np.quantile(squared_speed, INNER)
    if not high > low:
        return 0.0
    inner = squared_speed[(squared_speed >= low) & (squared_speed <= high)]
    centre = 0.5 * (low + high)
    reach = 0.5 * (high - low)
    place = (inner - centre) / reach
    root = np.polynomial.Polynomial.fit(
        place, np.sqrt(inner), SMOOTH_DEGREE, domain=[-1, 1]
    )
    # Where the speed is zero the derivative is infinite.
    least = np.finfo(float).eps * high
    derivative = 0.5 * reach / np.sqrt(np.maximum(inner, least))
    missed = derivative - root.deriv()(place)
    return float(np.sqrt(np.mean(missed**2) / np.mean(derivative**2)))


def _one_over(speed: float) -> float:
    if speed <= 0:
        return float("inf")
    return 1.0 / speed
