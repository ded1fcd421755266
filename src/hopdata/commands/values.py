"""Values from a JSON file of a study's results, which may be another file."""

from pathlib import Path
from typing import Any

from hopdata.errors import ConfigError
from hopdata.jobs import read_json


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
    try:
        content = read_json(file)
        return [content[key] for key in keys]
    except OSError as error:
        raise ConfigError(f"{file}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, RecursionError):
        raise ConfigError.at(file, f"the {name} of a study", "another file") from None
