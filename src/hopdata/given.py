"""What a user gives for a recording: numbers and names of markers, checked."""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import ArgumentError, RecordingError


def numbers(key: str, values: ArrayLike) -> FloatArray:
    """Return an argument as an array of floats.

    Raises
    ------
    ArgumentError
        If it is none; the message begins with the argument's name.
    """
    try:
        return np.ma.asarray(values, float).filled(np.nan)
    except (TypeError, ValueError) as error:
        first_sentence = str(error).partition(". ")[0]
        raise ArgumentError.at(key, "an array of numbers", first_sentence) from None


def marker_names(key: str, names: Iterable[str]) -> tuple[str, ...]:
    """Return a list of distinct names as a tuple.

    Raises
    ------
    RecordingError
        If it is anything else; the message begins with the key.
    """
    is_list = isinstance(names, Iterable) and not isinstance(names, str)
    found = tuple(names) if is_list else ()
    if not is_list or not all(isinstance(name, str) for name in found):
        raise RecordingError.at(key, "a list of marker names", f"{names!r}")
    if len(set(found)) < len(found):
        raise RecordingError.at(key, "each name once", ", ".join(found))
    return found


def feet_and_joined(
    feet: Iterable[str] | Mapping[str, Iterable[str]],
) -> tuple[tuple[str, ...], tuple[tuple[str, tuple[str, ...]], ...]]:
    """Return the markers of feet, and which of them are on one foot."""
    if not isinstance(feet, Mapping):
        return marker_names("feet", feet), ()
    markers: list[str] = []
    joined = []
    for foot, names in feet.items():
        own = marker_names(f"feet.{foot}", names)
        if not own:
            raise RecordingError.at(f"feet.{foot}", "a marker or several", "none")
        markers += own
        if own != (foot,):
            joined.append((str(foot), own))
    return marker_names("feet", markers), tuple(joined)
