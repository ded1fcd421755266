"""Trained processes on disk: one `.npz` file, written whole or not at all."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from hopdata.errors import RecordingError
from hopdata.jobs import whole_file
from hopdata.steering.models.process import FrameChangeProcess

# What reading a folder, a text, a picture, a single array or an archive of others ends in.
FOREIGN = (OSError, KeyError, ValueError, TypeError, AttributeError, EOFError, BadZipFile)


def save_process(path: str | Path, process: FrameChangeProcess) -> None:
    """Write a process; its fields are the arrays of the file."""
    arrays = {field.name: getattr(process, field.name) for field in fields(process)}
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


def load_process(path: str | Path) -> FrameChangeProcess:
    """Read a process that `save_process` wrote.

    Raises
    ------
    RecordingError
        If the file is missing or holds something else.
    """
    names = [field.name for field in fields(FrameChangeProcess)]
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in names}
        arrays["smoothness"] = float(arrays["smoothness"])
        arrays["periodic"] = bool(arrays["periodic"])
        return FrameChangeProcess(**arrays)
    except FileNotFoundError:
        raise RecordingError(f"{path}: expected a trained process, found no such file") from None
    except FOREIGN as error:
        raise RecordingError(
            f"{path}: expected a trained process with {', '.join(names)}, found another file"
        ) from error
