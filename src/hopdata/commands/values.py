"""Values from a JSON file of a study's results, which may be another file."""

from pathlib import Path
from typing import Any

from hopdata.errors import ConfigError
from hopdata.foreign.texts import json_of

# No count or size in a result is larger: a whole number in JSON may have any length.
LARGEST = 1e15
# Characters of a wrong value that a message shows.
MOST_SHOWN = 40


def values_of(file: Path, name: str, *keys: str) -> list[Any]:
    """Return the values of some keys.

    Parameters
    ----------
    file
        The file.
    name
        Name of such files in a study's results, for the error.

    Raises
    ------
    ConfigError
        If the file cannot be read, or is another one.
    """
    content = json_of(file, wanted=f"the {name} of a study")
    if not isinstance(content, dict) or not {*keys} <= {*content}:
        raise ConfigError.at(file, f"the {name} of a study", "another file")
    return [content[key] for key in keys]


def require_number(file: Path, key: str, value: Any) -> Any:
    """Return a value that must be a finite number, not below zero.

    Raises
    ------
    ConfigError
        If it is another one; names file and key.
    """
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not 0 <= value <= LARGEST:
        found = f"{value!r}"[:MOST_SHOWN]
        raise ConfigError.at(f"{file}: {key}", "a number, 0 or more", found)
    return value
