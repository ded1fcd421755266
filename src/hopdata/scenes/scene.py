"""The interface of a scene: a rigid body that lands on compliant feet.

A scene is one file with a frozen dataclass of parameters, derived from `Scene`, and the
compiled field, guards and handler of its system. It is registered by name in
`hopdata.scenes.SCENES`.

The state begins with the twelve states of the body (`hopdata.scenes.body`). Any further
states are the memory of feet in contact: they are zero in flight and never leave the
integrator. The guards are ``foot1`` ... ``foot<n>`` (two-way, +1 in contact), ``apex``
(falling; ends a hop, in flight after a landing) and ``fallen`` (terminal at any time).
Further modes start at 0.
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
    """A body that replaces the plain scene; its numbers follow the parameters."""

    @property
    def numbers(self) -> tuple[float, ...]:
        """Numbers that are appended to the parameter vector."""
        ...


@dataclass(frozen=True, kw_only=True)
class Control:
    """Strengths of three effects that make a landing not differentiable.

    With all strengths zero, the control equals the scene itself.

    Parameters
    ----------
    coupling : float
        kappa: relative change of each leg's force for every additional leg in contact.
    impulse : float
        eps: fraction of a foot's normal velocity that an impulse removes at touchdown.
    delay_s : float
        tau: time by which contact runs ahead of the gap (positive: before the foot is
        down), s.
    """

    coupling: float = 0.0
    impulse: float = 0.0
    delay_s: float = 0.0

    @property
    def numbers(self) -> tuple[float, ...]:
        """Strengths in the order of the fields."""
        return self.coupling, self.impulse, self.delay_s

    @property
    def active(self) -> bool:
        """Whether any strength differs from zero."""
        return any(self.numbers)


class Scene(ABC):
    """Parameters of a rigid body on n feet, and the system that they define."""

    #: Strengths of `Control` that the scene supports.
    controls: ClassVar[tuple[str, ...]] = ()
    #: Whether the body has a moving boom, with a marker on it.
    has_boom: ClassVar[bool] = False
    #: True if a foot in contact stays under its rest position, False if it stays where
    #: it touched.
    feet_slide: ClassVar[bool] = True
    #: Whether the handler of its system may change the state, such as a memory of feet.
    #: If not, the dissertation's method can integrate it, which has no resets.
    resets_state: ClassVar[bool] = True
    #: Whether its legs may differ in length from landing to landing: see `lengthened`.
    legs_can_scatter: ClassVar[bool] = False

    mass_kg: float
    preload_n: float
    stiffness_n_m: float
    release_extension_m: float
    gravity_m_s2: float
    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def total_mass_kg(self) -> float:
        """Total mass that the legs carry, kg."""
        return self.mass_kg

    @property
    def n_legs(self) -> int:
        """Number of feet."""
        return len(self.rest_feet())

    @property
    def leg_length_m(self) -> float:
        """Height of the level body's origin when the first foot touches, m."""
        return -float(self.rest_feet()[:, 2].min())

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states of its system, with their units.

        Those of the body, and ``memory1``, ``memory2`` ... of what feet in contact
        keep.
        """
        from hopdata.scenes.body import STATE_NAMES

        n_more = self.system().n_states - len(STATE_NAMES)
        return (*STATE_NAMES, *(f"memory{k + 1}" for k in range(n_more)))

    @abstractmethod
    def rest_feet(self) -> FloatArray:
        """Return the feet at rest length, (n, 3), body frame, m.

        They touch at a gap of zero.
        """

    @abstractmethod
    def system(self, variant: Variant | None = None, /) -> System:
        """Return the hybrid system; the same variant always yields the same object."""

    @abstractmethod
    def vector(
        self, preloads_n: FloatArray | None = None, variant: Variant | None = None, /
    ) -> FloatArray:
        """Return the flat parameter vector for the compiled functions.

        Parameters
        ----------
        preloads_n : (n,) array, optional
            Preload of each leg, N; `preload_n` for all legs if absent.
        variant : optional
            Body that replaces the plain scene.
        """

    def vectors(
        self,
        preloads_n: FloatArray,
        variant: Variant | None,
        _since_apex_s: FloatArray | float,
    ) -> FloatArray:
        """Return the parameter vectors (L, p) of L landings that start after the apex.

        Parameters
        ----------
        preloads_n : (L, n) array
            Preload of each leg, N.
        variant : optional
            Body that replaces the plain scene.
        since_apex_s : float or (L,) array
            Time from the apex to the start, s; only a moving boom depends on it.
        """
        return np.array([self.vector(row, variant) for row in preloads_n])

    def lengthened(self, _vectors: FloatArray, _longer_m: FloatArray, /) -> FloatArray:
        """Return parameter vectors (..., p) with legs longer by (..., n), m.

        The rest feet move along the body z-axis. Only a scene whose `legs_can_scatter`
        knows how.
        """
        raise NotImplementedError(type(self).__name__)

    def require_take_off(self, key: str) -> None:
        """Raise a `ConfigError` about `key` if extended legs cannot carry the body.

        Legs are taken for springs that push on until they are longer by
        `release_extension_m`. A scene that has no such parameters is not tested; one
        that has them, but whose legs follow another law, overrides this method.
        """
        for name in ("stiffness_n_m", "release_extension_m"):
            if not hasattr(self, name):
                return
        push = self.preload_n - self.stiffness_n_m * self.release_extension_m
        share = self.total_mass_kg * self.gravity_m_s2 / self.n_legs
        least = f"preload_n - stiffness_n_m release_extension_m > {share:.2f} N"
        wanted = f"{least}, the weight per leg"
        found = f"{push:.2f} N: it cannot lift off"
        if not type(self).__module__.startswith("hopdata."):
            found += " (if its legs follow another law, override require_take_off)"
        require(push > share, key, wanted, found)

    # Motion of a boom from hop to hop; by default there is no boom.

    def boom_places(self, times_s: FloatArray) -> FloatArray:
        """Return boom positions, body frame, m, at N times since the apex.

        (N, 3), or (N, 0) without a boom.
        """
        return np.empty((len(times_s), 0))

    def after(self, _time_s: float) -> Self:
        """Return the scene as it is when the next hop begins, this time later."""
        return self

    def still(self) -> Self:
        """Return the scene with a boom that rests at its present angle."""
        return self

    def by_hop(self, count: int) -> Iterator[tuple[Self, IntArray]]:
        """Yield, for each starting angle of a boom, the scene and its hops' indices."""
        yield self, np.arange(count)


def parameter(default: float, description: str, unit: str = "", **bounds: float) -> Any:
    """Declare a parameter of a scene, and with it a key of the configuration.

    Parameters
    ----------
    default : float or int
        Default value; its type is the type of the key.
    description, unit : str
        Text and unit for the configuration page.
    bounds
        JSON schema bounds: ``minimum``, ``exclusiveMinimum``, ``maximum``,
        ``exclusiveMaximum``.
    """
    metadata: dict[str, Any] = {"description": description}
    if unit:
        metadata["x-unit"] = unit
    return field(default=default, metadata={**metadata, **bounds})
