"""Every figure of the workflow: the function that draws it, and the files it is drawn from.

A figure is added by writing its function in one of this room's modules and its entry in
``catalogue.toml``, under the job that draws it; its caption stands in
``workflow/captions/<name>.md``.
"""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

# A date or a library version in a file would change its bytes without a change of the data.
#: Formats of figures, and what is written into a file beside the picture.
FORMATS: Mapping[str, Mapping[str, str | None]] = {
    "svg": {"Date": None, "Creator": "hopdata"},
    "png": {"Software": "hopdata"},
    "pdf": {"CreationDate": None, "Creator": "hopdata", "Producer": "hopdata"},
}


@dataclass(frozen=True)
class Drawing:
    """How a figure is made.

    Attributes
    ----------
    place
        Module and function, which takes tables and numbers in the order of `files`.
    files
        CSV and JSON files, by their paths below the folder of results.
    options
        Keyword arguments of the function.
    truth
        Further files, which only a simulated study has.
    """

    place: str
    files: Sequence[str]
    options: Mapping[str, Any] = field(default_factory=dict)
    truth: Sequence[str] = ()


_FILE = Path(__file__).with_suffix(".toml")
#: The jobs that draw, and by its name each figure that they draw.
FIGURES: dict[str, dict[str, Drawing]] = {
    job: {name: Drawing(**drawing) for name, drawing in drawings.items()}
    for job, drawings in tomllib.loads(_FILE.read_text("utf-8")).items()
}


def tables_of(name: str, *, simulated: bool = False) -> tuple[str, ...]:
    """Return the files that a figure is drawn from, by their paths below the results."""
    drawing = _drawing(name)
    return (*drawing.files, *(drawing.truth if simulated else ()))


def source_of(name: str) -> Path:
    """Return the module that draws a figure."""
    return Path(__file__).with_name(f"{_drawing(name).place.partition(':')[0]}.py")


def function_of(name: str) -> Callable[..., Any]:
    """Return the function that draws a figure, with its options."""
    drawing = _drawing(name)
    return partial(resolve_name(f"hopdata.figures.{drawing.place}"), **drawing.options)


def _drawing(name: str) -> Drawing:
    return next(drawings[name] for drawings in FIGURES.values() if name in drawings)
