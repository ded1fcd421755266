"""What synthesis asks of a scene: a rigid body that lands on compliant feet.

A scene is one file: a frozen dataclass of parameters that derives from `Scene`, and the compiled
field, guards and handler of its system. A line in `hopdata.scenes.SCENES` gives it its name.

Its state begins with the body's twelve (`hopdata.scenes.body`). What follows is memory of feet that
stand, is zero in flight, and never leaves the integrator. Its guards are ``foot1`` ... ``foot<n>``
(two-way, +1 in contact), ``apex`` (falling; ends a hop, in flight after a landing) and ``fallen``
(ends it at any time). Further modes begin at 0.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import require

if TYPE_CHECKING:
    from hopdata.hybrid import System


class Variant(Protocol):
    """What lands in place of the plain scene: it has a few numbers more, after the parameters."""

    @property
    def numbers(self) -> tuple[float, ...]:
        """Its numbers."""
        ...


@dataclass(frozen=True, kw_only=True)
class Control:
    """Strengths of three ways to break what makes a landing continuously differentiable.

    With all of them zero it is the scene itself.

    Parameters
    ----------
    coupling : float
        kappa: change of each leg's force for every leg more in contact, as a fraction.
    impulse : float
        eps: fraction of a foot's normal velocity that touchdown takes by an impulse.
    delay_s : float
        tau: time by which contact runs ahead of the gap (positive: before the foot is down), s.
    """

    coupling: float = 0.0
    impulse: float = 0.0
    delay_s: float = 0.0

    @property
    def numbers(self) -> tuple[float, ...]:
        """The strengths."""
        return self.coupling, self.impulse, self.delay_s

    @property
    def active(self) -> bool:
        """Whether any strength differs from zero."""
        return any(self.numbers)


class Scene(ABC):
    """Parameters of a rigid body on n feet, and what it does with them."""

    #: Strengths of `Control` that the scene knows.
    controls: ClassVar[tuple[str, ...]] = ()
    #: Whether a boom moves in the body, with a marker on it.
    has_boom: ClassVar[bool] = False
    #: Whether a foot in contact stays under its rest place; else it stays where it touched.
    feet_slide: ClassVar[bool] = True

    mass_kg: float
    preload_n: float
    stiffness_n_m: float
    release_extension_m: float
    gravity_m_s2: float
    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def total_mass_kg(self) -> float:
        """Mass of all that the legs carry."""
        return self.mass_kg

    @property
    def n_legs(self) -> int:
        """Number of feet."""
        return len(self.rest_feet())

    @property
    def leg_length_m(self) -> float:
        """Height of the level body's origin at which the first foot is on the floor."""
        return -float(self.rest_feet()[:, 2].min())

    @abstractmethod
    def rest_feet(self) -> FloatArray:
        """Feet at rest length, (n, 3), body frame, m; at a gap of zero they touch."""

    @abstractmethod
    def system(self, variant: Variant | None = None, /) -> System:
        """Return the hybrid system, always the same object for the same variant."""

    @abstractmethod
    def vector(
        self, preloads_n: FloatArray | None = None, variant: Variant | None = None, /
    ) -> FloatArray:
        """Flat parameter vector for the compiled functions.

        Parameters
        ----------
        preloads_n : (n,) array, optional
            Preload of each leg, N; `preload_n` for all legs if absent.
        variant : optional
            What lands in the scene's place.
        """

    def vectors(
        self, preloads_n: FloatArray, variant: Variant | None, _since_apex_s: FloatArray | float
    ) -> FloatArray:
        """Parameter vectors (L, p) of L landings that are integrated from so long after the apex.

        Parameters
        ----------
        preloads_n : (L, n) array
            Preload of each leg, N.
        variant : optional
            What lands in the scene's place.
        since_apex_s : float or (L,) array
            Time at the beginning since the apex, s; only a moving boom asks for it.
        """
        return np.array([self.vector(row, variant) for row in preloads_n])

    def require_take_off(self, key: str) -> None:
        """Raise a `ConfigError` that begins with `key` if extended legs do not carry the weight."""
        push = self.preload_n - self.stiffness_n_m * self.release_extension_m
        share = self.total_mass_kg * self.gravity_m_s2 / self.n_legs
        wanted = f"preload_n - stiffness_n_m release_extension_m > {share:.2f} N"
        found = f"{push:.2f} N: it cannot lift off"
        require(push > share, key, f"{wanted}, the weight per leg", found)

    # What a boom does from hop to hop; by default there is none.

    def boom_places(self, times_s: FloatArray) -> FloatArray:
        """Places of the boom, body frame, (N, 3) m, at times since the apex; (N, 0) without."""
        return np.empty((len(times_s), 0))

    def after(self, _time_s: float) -> Self:
        """Return the scene as the next hop begins, so long after this hop's apex."""
        return self

    def still(self) -> Self:
        """Return the scene with a boom that rests where it is."""
        return self

    def by_hop(self, count: int) -> Iterator[tuple[Self, IntArray]]:
        """Yield the scene and the numbers of its hops, for each place of a boom that swings."""
        yield self, np.arange(count)


def parameter(default: float, description: str, unit: str = "", **bounds: float) -> Any:
    """Declare a parameter of a scene, which makes its key of the configuration.

    Parameters
    ----------
    default : float or int
        Its kind is that of the key.
    description, unit : str
        For the page on the configuration.
    bounds
        As in JSON schema: ``minimum``, ``exclusiveMinimum``, ``maximum``, ``exclusiveMaximum``.
    """
    told = {"description": description} | ({"x-unit": unit} if unit else {})
    return field(default=default, metadata={**told, **bounds})
