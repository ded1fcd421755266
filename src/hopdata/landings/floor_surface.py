"""The floor's surface: a polynomial inside a rim, and the mount heights of the feet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.polynomial.polynomial import polyvander
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray, Shown
from hopdata.landings.floor_rests import RestPoints
from hopdata.landings.sections.modes import robust_rms
from hopdata.messages import Message

CHUNK = 8192  # frames whose floor is computed together, to bound memory

#: Deviations at which Tukey's weight reaches zero.
#: Unit: standard deviations. Origin: table: 95 % efficiency for normal residuals.
BIWEIGHT = 4.685

#: Directions in which the rim is found; the polygon overshoots a round rim by at most
#: 0.9 %.
#: Unit: 1. Origin: chosen.
RIM_DIRECTIONS = 24

#: Relative singular value below which columns are collinear.
#: Unit: 1. Origin: chosen.
COLLINEAR = 1e-6

#: Most rounds of a robust regression.
#: Unit: 1. Origin: chosen.
MOST_ROUNDS = 100

#: Change of the coefficients, in units of the residuals, at which a robust regression
#: ends.
#: Unit: 1. Origin: chosen.
STATIONARY = 1e-10

# Codes of messages about a floor.
SLOPES = "landings.floor_slopes"
NOTED = "landings.floor_noted"

Terms = tuple[tuple[int, int], ...]


def own_axis(places: FloatArray) -> FloatArray:
    """Return the unit vector (2,) along which places (P, 2) spread most.

    Its sign is arbitrary. The axes of the laboratory are nobody's choice. What is
    measured along this one and across it is the same for a recording that was turned
    about the vertical.
    """
    from_mean = places - places.mean(axis=0)
    return np.asarray(np.linalg.eigh(from_mean.T @ from_mean)[1][:, -1])


def along(places: FloatArray, axis: FloatArray) -> FloatArray:
    """Return places (P, 2) in coordinates along a unit vector (2,) and to its left."""
    left = np.array([-axis[1], axis[0]])
    return np.asarray(places @ np.stack([axis, left], axis=1))


@dataclass(frozen=True, repr=False)
class FloorModel(Shown):
    """A floor surface and the mount heights of the feet.

    Parameters
    ----------
    terms : tuple of (int, int)
        Exponents (i, j) of u^i v^j. The scaled coordinates u and v are the distances
        from the centre along `axis` and to its left, divided by `scale_m`.
    coefficients_m : (T,) array
        Coefficient of each term, m.
    centre_m : (2,) array
        Origin of the scaled coordinates, m.
    scale_m : float
        Unit of the scaled coordinates, m.
    rim_m : (K,) array
        Reach of the rest points from the centre in K directions, equally spaced from
        `axis` towards its left, m. The floor is known inside the polygon of these K
        half-planes.
    feet : tuple of str
        Names of the feet.
    foot_offsets_m : (n,) array
        Height of each foot's marker above the mean of all feet, m; sums to zero.
    residual_rms_m : float
        Robust deviation of the rest points from the model (1.4826 median |residual|),
        m.
    n_points, n_outliers : int
        Number of rest points near the floor, and how many of them the fit rejects,
        including raised ones.
    degree, degree_wanted : int
        Degree of the polynomial, and the degree requested. The first is lower if the
        feet at rest do not cover enough ground.
    messages : tuple of Message
        Whether the floor moves, which feet often rest above it, why the degree is
        lower, that it slopes, or that compensation is off.
    moved_s, moved_m : (W,) arrays
        Instants, s, and the rise of the floor at each, m; a single 0 if it does not
        move.
    axis : (2,) array
        Unit vector in the world along which the rest points spread most.
    """

    terms: Terms
    coefficients_m: FloatArray
    centre_m: FloatArray
    scale_m: float
    rim_m: FloatArray
    feet: tuple[str, ...]
    foot_offsets_m: FloatArray
    residual_rms_m: float
    n_points: int
    n_outliers: int
    degree: int
    degree_wanted: int
    messages: tuple[Message, ...] = ()
    moved_s: FloatArray = field(default_factory=lambda: np.zeros(1))
    moved_m: FloatArray = field(default_factory=lambda: np.zeros(1))
    axis: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0]))

    def _told(self) -> str:
        rests = f"{self.n_points:,} rests of {', '.join(self.feet)}"
        scatter = f"within {1e3 * self.residual_rms_m:.2g} mm (rms)"
        return f"of degree {self.degree} under {rests}, {scatter}"

    @property
    def note(self) -> str:
        """The messages in words; empty if there is nothing to report."""
        return "; ".join(message.text() for message in self.messages)

    @property
    def slopes(self) -> bool:
        """Whether the floor slopes by so much that it is reported."""
        return any(message.code == SLOPES for message in self.messages)

    @property
    def moves(self) -> bool:
        """Whether the floor moves up and down."""
        return len(self.moved_s) > 1

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the floor's height, m, at places (x, y) of any shape; NaN at NaN.

        A place beyond the rim of the ground stepped on is first moved straight towards
        the centre onto the rim, so that the polynomial never extrapolates.
        """
        place = np.stack(np.broadcast_arrays(x, y), axis=-1).astype(np.float64)
        columns = design(self._scaled(place.reshape(-1, 2)), self.terms)
        heights = columns @ self.coefficients_m
        return np.asarray(heights).reshape(place.shape[:-1])

    def _scaled(self, place: FloatArray) -> FloatArray:
        """Scale places (P, 2), and move those beyond the rim onto it."""
        scaled = along(place - self.centre_m, self.axis) / self.scale_m
        return within_rim(scaled, self.rim_m / self.scale_m)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers and lists, for JSON."""
        out: dict[str, Any] = {}
        for name, value in vars(self).items():
            if name == "messages":
                out["note"] = self.note
            elif isinstance(value, np.ndarray):
                out[name] = value.tolist()
            else:
                out[name] = value
        if np.isnan(self.residual_rms_m):
            out["residual_rms_m"] = None  # JSON has no NaN
        out["terms"] = [list(term) for term in self.terms]
        out["feet"] = list(self.feet)
        out["messages"] = [message.to_dict() for message in self.messages]
        return out

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Self:
        """Make the model from the fields that `to_dict` returns."""
        made = dict(fields)
        arrays = [
            "coefficients_m",
            "centre_m",
            "rim_m",
            "foot_offsets_m",
            "moved_s",
            "moved_m",
        ]
        if "axis" in fields:  # files of earlier versions have u along x
            arrays.append("axis")
        for name in arrays:
            made[name] = np.array(fields[name], dtype=float)
        made["terms"] = tuple((int(i), int(j)) for i, j in fields["terms"])
        made["feet"] = tuple(fields["feet"])
        made["residual_rms_m"] = float(np.array(fields["residual_rms_m"], dtype=float))
        note = made.pop("note")
        if "messages" in fields:
            messages = [Message.from_dict(one) for one in fields["messages"]]
        elif note:  # files of earlier versions have only the words
            messages = [Message(NOTED, {"text": note})]
        else:
            messages = []
        made["messages"] = tuple(messages)
        return cls(**made)


def design(scaled: FloatArray, terms: Terms) -> FloatArray:
    """Return the columns u^i v^j, (P, T), for places (P, 2) in scaled coordinates."""
    u, v = polyvander(scaled.T, max(map(max, terms))).transpose(0, 2, 1)
    return np.stack([u[i] * v[j] for i, j in terms]).T


def polynomial_terms(degree: int) -> Terms:
    """List the exponents (i, j) with i + j <= `degree`, by total degree."""
    return tuple(
        (total - j, j) for total in range(degree + 1) for j in range(total + 1)
    )


def rim_of(places: FloatArray, n_directions: int) -> FloatArray:
    """Return the reach of places (P, 2) from the origin in K directions, (K,)."""
    reach = (places @ directions(n_directions).T).max(axis=0)
    return np.maximum(reach, 1e-6 * np.abs(reach).max())


def within_rim(places: FloatArray, rim: FloatArray) -> FloatArray:
    """Move places (P, 2) beyond the rim towards the origin onto the rim."""
    moved = np.array(places, dtype=np.float64)
    square_distance = np.einsum("pk,pk->p", places, places)
    outer = np.flatnonzero(square_distance > max(rim.min(), 0.0) ** 2)
    if not rim.any():  # feet that rest at one spot have no rim but this spot
        moved[outer] = 0.0
        return moved
    beyond = np.max(places[outer] @ directions(len(rim)).T / rim, axis=1)
    moved[outer] /= np.maximum(beyond, 1.0)[:, np.newaxis]
    return moved


def directions(n: int) -> FloatArray:
    """Make unit vectors (n, 2), equally spaced from the first axis to the second."""
    angle = 2.0 * np.pi * np.arange(n) / n
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


# Robust regression of the floor, at the highest degree that the rests determine.


@dataclass(frozen=True)
class FloorRegression:
    """Outcome of one regression.

    Parameters
    ----------
    terms, coefficients_m : tuple, (T,) array
        Exponents of the polynomial, and the coefficients, m.
    offsets_m : (n,) array
        Mount heights of the feet, m; they sum to zero.
    residuals : (P,) array
        Residuals of all rest points, including those not fitted, m.
    degree : int
        Degree of the polynomial.
    """

    terms: Terms
    coefficients_m: FloatArray
    offsets_m: FloatArray
    residuals: FloatArray
    degree: int


def regress_floor(
    rest: RestPoints,
    scaled: FloatArray,
    near: BoolArray,
    *,
    degree: int,
    largest_error_m: float,
    independent_share: float,
) -> FloorRegression:
    """Fit floor and mount heights at the highest degree that is accurate enough.

    Parameters
    ----------
    rest : RestPoints
        Feet at rest.
    scaled : (P, 2) array
        Their places in scaled coordinates.
    near : (P,) bool array
        Points to fit.
    degree : int
        Highest degree to try.
    largest_error_m : float
        Largest standard error of the floor on its rim, m.
    independent_share : float
        Share of independent points, 0 to 1; the points of one step share their error.
    """
    contrasts = _sum_to_zero(len(rest.start_m))
    far = 1e3 * directions(RIM_DIRECTIONS)
    rim = within_rim(far, rim_of(scaled[near], RIM_DIRECTIONS))
    for tried in range(degree, -1, -1):
        terms = polynomial_terms(tried)
        columns = floor_columns(rest, scaled, terms)
        spread = _floor_spread(columns[near], design(rim, terms))
        if tried > 0 and not np.isfinite(spread):
            continue
        estimate = robust_regression(columns[near], rest.points[near, 2])
        residuals = rest.points[:, 2] - columns @ estimate
        error_m = robust_rms(residuals[near]) * spread / np.sqrt(independent_share)
        if tried == 0 or error_m <= largest_error_m:
            break
    n_terms = len(terms)
    offsets = contrasts @ estimate[n_terms:]
    return FloorRegression(terms, estimate[:n_terms], offsets, residuals, tried)


def robust_regression(columns: FloatArray, values: FloatArray) -> FloatArray:
    """Regress values (n,) on columns (n, k) with little weight on outliers, (k,).

    These are M-estimates with Tukey's biweight (c = 4.685), with weights iterated until
    the coefficients are stationary. The scale is the median absolute residual.
    statsmodels' `RLM` gives the same result, but takes longer to load than the rest of
    the job to run.
    """
    found = np.linalg.lstsq(columns, values, rcond=None)[0]
    perfect = np.finfo(float).eps * np.abs(values).max(initial=0.0)
    for _ in range(MOST_ROUNDS):
        residuals = values - columns @ found
        scale = robust_rms(residuals)
        if scale <= perfect:
            break
        # The root of Tukey's weights.
        root = np.clip(1 - (residuals / scale / BIWEIGHT) ** 2, 0, None)
        before = found
        found = np.linalg.lstsq(columns * root[:, None], values * root, rcond=None)[0]
        if np.abs(found - before).max() <= STATIONARY * scale:
            break
    return np.asarray(found)


def floor_columns(rest: RestPoints, scaled: FloatArray, terms: Terms) -> FloatArray:
    """Return polynomial terms at places (P, 2), and contrasts of the mounts."""
    mounts = _sum_to_zero(len(rest.start_m))[rest.foot]
    return np.hstack([design(scaled, terms), mounts])


def _floor_spread(columns: FloatArray, rim: FloatArray) -> float:
    """Return the largest standard error on the rim for unit residuals.

    It is infinite if the data do not determine the floor. The error is that of the
    floor alone, without the offset of the foot that stands on it. If each foot stays in
    its own place, the data cannot separate a slope from mount heights and determine
    only their sum. The rim is where a polynomial is least certain.
    """
    _, values, right = np.linalg.svd(columns, full_matrices=False)
    if len(columns) <= columns.shape[1] or values[-1] < COLLINEAR * values[0]:
        return float("inf")
    errors = rim @ (right / values[:, np.newaxis]).T[: rim.shape[1]]
    return float(np.linalg.norm(errors, axis=1).max())


def _sum_to_zero(n_feet: int) -> FloatArray:
    """Return contrasts (n, n - 1) that span all offsets that sum to zero."""
    return np.vstack([np.eye(n_feet - 1), -np.ones((1, n_feet - 1))])
