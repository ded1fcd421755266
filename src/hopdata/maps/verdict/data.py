"""What a study brings to its verdict: its arrays and options, and their checks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.errors import AnalysisError, require
from hopdata.given import numbers
from hopdata.maps.verdict import inputs, rows
from hopdata.maps.verdict.session import Session


@dataclass(frozen=True)
class Measured:
    """The arrays of a study, of shapes that match: see `judge`."""

    before: FloatArray
    after: FloatArray
    instants: FloatArray
    instants_se: FloatArray | None
    feet: FloatArray | None = None
    feet_se: FloatArray | None = None
    time: FloatArray | None = None
    blocks: IntArray | None = None

    @property
    def n_feet(self) -> int:
        """Return the number of feet."""
        return self.instants.shape[1]

    @property
    def n_known(self) -> int:
        """Return of how many landings all states and instants are known."""
        return int(self.known().sum())

    def known(self) -> BoolArray:
        """Return of which landings all states and instants are known, (n,)."""
        both = np.hstack([self.before, self.after, self.instants])
        return np.asarray(np.isfinite(both).all(axis=1))

    def sound_landings(self, *, keep_far_off: bool = False) -> rows.Sound:
        """Return the known landings without gross errors, or all if these are kept.

        Raises
        ------
        UnsoundError
            If these do not suffice.
        """
        known = np.flatnonzero(self.known())
        if keep_far_off:
            return rows.Sound(self.landings(known), {})
        try:
            found = rows.sound_landings(
                self.before[known],
                self.after[known],
                lambda some: self.landings(known[some]),
            )
        except rows.UnsoundError as error:
            error.left_out = _as_in_a_table(error.left_out, known)
            raise
        return rows.Sound(found.landings, _as_in_a_table(found.left_out, known))

    def unknown(self) -> dict[str, list[int]]:
        """Return which landings cannot be judged, from 1, by what is not known."""
        states = np.hstack([self.before, self.after])
        has_state = np.isfinite(states).all(axis=1)
        has_contacts = np.isfinite(self.instants).all(axis=1)
        lost = {
            "without_state": np.flatnonzero(~has_state),
            "without_contact": np.flatnonzero(has_state & ~has_contacts),
        }
        return {why: (some + 1).tolist() for why, some in lost.items() if len(some)}

    def landings(self, known: IntArray) -> inputs.SectionLandings:
        """Return landings by their numbers, in the coordinates of the verdict."""
        errors = None
        if self.instants_se is not None:
            errors = np.nan_to_num(self.instants_se[known])
        feet = None
        if self.feet is not None:
            feet = self.feet[known]
        feet_se = None
        if self.feet_se is not None:
            feet_se = self.feet_se[known]
        contacts = inputs.Contacts(self.instants[known], errors, feet, feet_se)
        return inputs.section_landings(
            self.before[known],
            self.after[known],
            contacts,
            self.session(known),
            aside=self.n_known - len(known),
        )

    def session(self, known: IntArray) -> Session:
        """Return when and where these landings were recorded."""
        time = self.time
        if time is None:
            time = np.arange(len(self.before), dtype=float)
        blocks = self.blocks
        if blocks is None:
            blocks = np.zeros(len(self.before), dtype=np.int64)
        return Session.of(time[known], blocks[known])


def _as_in_a_table(
    left_out: Mapping[str, list[int]], known: IntArray
) -> dict[str, list[int]]:
    """Return numbers of landings, from 1, of which some are known."""
    return {reason: (known[some] + 1).tolist() for reason, some in left_out.items()}


def measured(
    x: ArrayLike, y: ArrayLike, instants: ArrayLike, instants_se: ArrayLike | None
) -> Measured:
    """Return the arrays, if their shapes match."""
    before = numbers("x", x)
    after = numbers("y", y)
    touched = numbers("instants", instants)
    are_tables = before.ndim == 2 and after.ndim == 2 and touched.ndim == 2
    matches = (
        are_tables
        and before.shape == after.shape
        and len(before) == len(touched)
        and before.shape[1] > 0
        and before.shape[1] % 6 == 0
    )
    if not matches:
        expected = "one row per landing, (n, 6B), (n, 6B), (n, feet)"
        found = f"{before.shape}, {after.shape}, {touched.shape}"
        raise AnalysisError.at("x, y, instants", expected, found)
    errors = None
    if instants_se is not None:
        errors = numbers("instants_se", instants_se)
        wanted = f"a standard error for each instant, {touched.shape}"
        matches = errors.shape == touched.shape
        require(matches, "instants_se", wanted, errors.shape)
        _require_no_negative("instants_se", errors)
    return Measured(before, after, touched, errors)


def _require_no_negative(name: str, errors: FloatArray) -> None:
    """Raise a `ConfigError` if a standard error is below zero; NaN is not known."""
    below = int((errors < 0.0).sum())
    wanted = "standard errors, zero or more"
    require(below == 0, name, wanted, f"{below} below zero")


def require_foot_names(foot_names: Sequence[str], n_feet: int) -> None:
    """Raise a `ConfigError` unless each foot has a name of its own, or none has one."""
    names = tuple(foot_names)
    is_list = not isinstance(foot_names, str)
    fits = is_list and len(names) == len(set(names)) == n_feet
    found: Any = ", ".join(str(name) for name in names)
    if not is_list:
        found = repr(foot_names)
    require(not names or fits, "foot_names", f"{n_feet} names, all different", found)


def with_feet(
    measured: Measured, feet: ArrayLike | None, feet_se: ArrayLike | None
) -> Measured:
    """Return the data with the feet at the pre section, if their shapes match."""
    if feet is None:
        wanted = "nothing without feet, whose errors they are"
        require(feet_se is None, "feet_se", wanted, "errors")
        return measured
    places = numbers("feet", feet)
    shape = (*measured.instants.shape, 3)
    wanted = f"a position for each foot in each landing, {shape}"
    require(places.shape == shape, "feet", wanted, places.shape)
    errors = None
    if feet_se is not None:
        errors = numbers("feet_se", feet_se)
        wanted = f"a standard error for each coordinate of feet, {shape}"
        require(errors.shape == shape, "feet_se", wanted, errors.shape)
        _require_no_negative("feet_se", errors)
    return replace(measured, feet=places, feet_se=errors)


def with_session(
    measured: Measured, time: ArrayLike | None, blocks: ArrayLike | None
) -> Measured:
    """Return the data with time and block of each landing, if their shapes match."""
    n_landings = len(measured.before)
    if time is not None:
        instants = numbers("time", time)
        is_known = bool(np.isfinite(instants).all())
        fits = instants.shape == (n_landings,) and is_known
        wanted = f"an instant for each of {n_landings} landings"
        found: Any = instants.shape
        if instants.shape == (n_landings,):
            found = f"{int((~np.isfinite(instants)).sum())} that are not finite"
        require(fits, "time", wanted, found)
        measured = replace(measured, time=instants)
    if blocks is not None:
        labels = np.asarray(blocks)
        wanted = f"a label for each of {n_landings} landings"
        require(labels.shape == (n_landings,), "blocks", wanted, labels.shape)
        _, numbered = np.unique(labels.astype(str), return_inverse=True)
        measured = replace(measured, blocks=np.asarray(numbered, np.int64))
    return measured


@dataclass(frozen=True)
class Options:
    """What is asked for: see `judge`."""

    seed: int
    margin: float
    confidence: float
    power: float
    flips: int

    def check(self) -> None:
        """Raise a `ConfigError` unless every option is a number in its range."""
        for key, share in (("confidence", self.confidence), ("power", self.power)):
            fits = isinstance(share, Real) and 0 < share < 1
            require(fits, key, "a number between 0 and 1", share)
        fits = isinstance(self.margin, Real) and 0 < self.margin <= 1
        require(fits, "margin", "a number in (0, 1]", self.margin)
        fits = isinstance(self.seed, Integral) and self.seed >= 0
        require(fits, "seed", "a whole number, 0 or more", self.seed)
        # With fewer flips no p-value could be small enough.
        least = ceil(1 / (1 - self.confidence))
        fits = isinstance(self.flips, Integral) and self.flips >= least
        require(fits, "flips", f"a whole number, {least} or more", self.flips)
