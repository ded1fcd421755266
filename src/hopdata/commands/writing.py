"""Files that a command writes: whole or not at all, or one clear message."""

from __future__ import annotations

from pathlib import Path

from hopdata.errors import HopdataError


def write_text(path: Path, text: str) -> None:
    """Write a text file and the folders on its way.

    Raises
    ------
    HopdataError
        If the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise HopdataError(
            f"{path}: expected a file that can be written, found: {error.strerror}"
        ) from None
