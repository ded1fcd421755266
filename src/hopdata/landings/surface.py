"""The floor's surface: a polynomial inside a rim, and the mount heights of the feet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
Terms = tuple[tuple[int, int], ...]

_CHUNK = 65536  # places whose rim is worked out together


@dataclass(frozen=True)
class FloorModel:
    """A floor surface and the mount heights of the feet.

    Parameters
    ----------
    terms : tuple of (int, int)
        Exponents (i, j) of u^i v^j, with u = (x - centre_x) / scale and v likewise.
    coefficients_m : (T,) array
        Coefficient of each term, m.
    centre_m : (2,) array
        Origin of the scaled coordinates, m.
    scale_m : float
        Unit of the scaled coordinates, m.
    rim_m : (K,) array
        How far the rest points reach from the centre in K directions, equally spaced from +x
        turning to +y, m: the floor is known inside the polygon of these K half-planes.
    feet : tuple of str
        Names of the feet.
    foot_offsets_m : (n,) array
        Height of each foot's marker above the mean of all feet's, m; sums to zero.
    residual_rms_m : float
        Robust deviation of the rest points from the model (1.4826 median |residual|), m.
    n_points, n_outliers : int
        Rest points near the floor, and those among them that the fit gave up, raised ones included.
    degree, degree_wanted : int
        Degree of the polynomial, and the one asked for: lower where the feet at rest do not
        cover enough ground.
    note : str
        Which feet often rest above the floor, why the degree is lower, or that no floor was asked
        for; else empty.
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
    note: str = ""

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Height of the floor at places (x, y) of any one shape, m; NaN where a place is NaN.

        A place beyond the rim of the ground stepped on is first moved straight towards the
        centre until it stands on the rim, so that the polynomial never extrapolates.
        """
        place = np.stack(np.broadcast_arrays(x, y), axis=-1).astype(np.float64)
        flat = place.reshape(-1, 2)
        heights = [
            design(self._scaled(flat[i : i + _CHUNK]), self.terms) @ self.coefficients_m
            for i in range(0, len(flat), _CHUNK)
        ]
        return (np.concatenate(heights) if heights else np.empty(0)).reshape(place.shape[:-1])

    def _scaled(self, place: FloatArray) -> FloatArray:
        """Scaled coordinates of places (P, 2), those beyond the rim moved onto it."""
        return within_rim((place - self.centre_m) / self.scale_m, self.rim_m / self.scale_m)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers and lists, for JSON."""
        out: dict[str, Any] = {}
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            out[name] = value.tolist() if isinstance(value, np.ndarray) else value
        if np.isnan(self.residual_rms_m):
            out["residual_rms_m"] = None  # JSON has no NaN
        return out | {"terms": [list(term) for term in self.terms], "feet": list(self.feet)}

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> FloorModel:
        """Make the model from what `to_dict` gave."""
        arrays = ("coefficients_m", "centre_m", "rim_m", "foot_offsets_m")
        made = dict(fields) | {name: np.array(fields[name], dtype=float) for name in arrays}
        made["terms"] = tuple((int(i), int(j)) for i, j in fields["terms"])
        made["feet"] = tuple(fields["feet"])
        if fields["residual_rms_m"] is None:
            made["residual_rms_m"] = float("nan")
        return cls(**made)


def design(scaled: FloatArray, terms: Terms) -> FloatArray:
    """Columns u^i v^j for places (P, 2) in scaled coordinates, (P, T)."""
    highest = max((max(term) for term in terms), default=0)
    u, v = (_powers(np.ascontiguousarray(scaled[:, k]), highest) for k in (0, 1))
    return np.stack([u[i] * v[j] for i, j in terms]).T


def _powers(x: FloatArray, highest: int) -> list[FloatArray]:
    powers = [np.ones_like(x)]
    for _ in range(highest):
        powers.append(powers[-1] * x)
    return powers


def polynomial_terms(degree: int) -> Terms:
    """Exponents (i, j) with i + j <= `degree`, by total degree."""
    return tuple((total - j, j) for total in range(degree + 1) for j in range(total + 1))


def rim_of(places: FloatArray, n_directions: int) -> FloatArray:
    """How far places (P, 2) about the origin reach in each of equally spaced directions, (K,)."""
    reach = (places @ directions(n_directions).T).max(axis=0)
    return np.maximum(reach, 1e-6 * np.abs(reach).max())


def within_rim(places: FloatArray, rim: FloatArray) -> FloatArray:
    """Places (P, 2), those beyond the rim moved towards the origin until they stand on it."""
    moved = np.array(places, dtype=np.float64)
    outer = np.flatnonzero(np.einsum("pk,pk->p", places, places) > max(rim.min(), 0.0) ** 2)
    beyond = np.max(places[outer] @ directions(len(rim)).T / rim, axis=1)
    moved[outer] /= np.maximum(beyond, 1.0)[:, np.newaxis]
    return moved


def directions(n: int) -> FloatArray:
    """Make unit vectors (n, 2), equally spaced from +x turning to +y."""
    angle = 2.0 * np.pi * np.arange(n) / n
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
