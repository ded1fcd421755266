"""Numbers in an item's sentences: one number, or the median and range over seeds."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

from hopdata.report.formatting import MINUS, NO_BREAK_SPACE, RAISED, significant

_POWER = re.compile(r"e([-+]\d+)")
_SIGN = re.compile(r"-(?=[\d.])")
_TIMES = f"{NO_BREAK_SPACE}×{NO_BREAK_SPACE}"
# Numbers from here on may be written with a power of ten.
FEWEST_POWER = 1e5


def filled(template: str, values: Mapping[str, Any]) -> str:
    """Put a row's values into a sentence.

    Parameters
    ----------
    template
        Text with values in braces, as in `str.format`.
    values
        The values by name. A sequence of numbers is written as its median and range.

    Raises
    ------
    KeyError
        If the sentence asks for a value that is not there.
    ValueError
        If the format does not suit the value.
    """
    shown = {name: _Shown(value) for name, value in values.items()}
    return template.format_map(shown)


class _Shown:
    """A value in a sentence, which formats itself."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __format__(self, form: str) -> str:
        return _written(self.value, form)


def _written(value: Any, form: str) -> str:
    """Return a value in words or numbers, by a format as of `str.format`."""
    # A truth value is also an integer, so it comes first.
    if isinstance(value, bool):
        if value:
            return "yes"
        return "no"
    if isinstance(value, str):
        return format(value, form)
    if isinstance(value, Sequence):
        return _over_seeds(value, form)
    return _number(value, form)


def _over_seeds(values: Sequence[Any], form: str) -> str:
    """Return ``median (low to high)``, or one text if all are written alike."""
    if any(isinstance(value, str) for value in values):
        written = [_written(value, form) for value in values]
        # Each text once, in the order in which they came.
        return ", ".join(dict.fromkeys(written))
    middle = _number(median(values), form)
    low = _number(min(values), form)
    high = _number(max(values), form)
    if low == high:
        return middle
    return f"{middle} ({low} to {high})"


def _number(value: float, form: str) -> str:
    """Return a number with a true minus, and a power of ten where it has one."""
    if not form:
        return significant(value)
    if form.endswith("d"):
        value = round(value)
    if form.endswith("g") and FEWEST_POWER > abs(value) >= 1:
        # Python would write 30 to one digit as 3e+01.
        return f"{float(format(value, form)):g}".replace("-", MINUS)
    written = format(value, form).replace("%", f"{NO_BREAK_SPACE}%")
    text = _POWER.sub(_power, written)
    text = _SIGN.sub(MINUS, text)
    # A power alone: 10^-16 for 1 x 10^-16.
    return text.removeprefix(f"1{_TIMES}")


def _power(found: re.Match[str]) -> str:
    """Write ``e-16`` as a power of ten."""
    exponent = int(found[1])
    if exponent == 0:
        return ""
    return f"{_TIMES}10{str(exponent).translate(RAISED)}"
