"""Every figure of the workflow: the function that draws it, and its files.

To add a figure, write its function in one of this package's modules and its entry in
``catalogue.toml``, under the job that draws it. Its caption is in
``workflow/captions/<name>.md``. Products (`hopdata.products`) have catalogues of their
own, of functions in their own modules.
"""

import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from importlib.metadata import EntryPoint
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from hopdata import products
from hopdata.foreign.plugins import blamed, name_of, plugins

# A date or library version in a file would change its bytes although the data are the
# same.
#: Formats of figures, and the metadata written to each file.
FORMATS: Mapping[str, Mapping[str, str | None]] = {
    "svg": {"Date": None, "Creator": "hopdata"},
    "png": {"Software": "hopdata"},
    "pdf": {"CreationDate": None, "Creator": "hopdata", "Producer": "hopdata"},
}


@dataclass(frozen=True)
class Drawing:
    """Definition of a figure.

    Attributes
    ----------
    place
        Module and function; the function takes the contents of `files`, in order.
    source
        The file of the module.
    files
        CSV and JSON files, as paths relative to the folder of results.
    options
        Keyword arguments of the function.
    truth
        Further files, which only simulated studies have.
    """

    place: str
    source: Path
    files: Sequence[str]
    options: Mapping[str, Any] = field(default_factory=dict)
    truth: Sequence[str] = ()


#: The figure of the distances between constraint subspaces, which a study may leave
#: out.
OF_DISTANCES = "fig2_5_distances"


def _drawings(file: Path, package: str) -> dict[str, dict[str, Drawing]]:
    """Return the figures of each job in a catalogue, drawn by this package."""
    jobs: dict[str, dict[str, Drawing]] = {}
    for job, drawings in tomllib.loads(file.read_text("utf-8")).items():
        jobs[job] = {}
        for name, entry in drawings.items():
            place = f"{package}.{entry.pop('place')}"
            module = place.partition(":")[0].rpartition(".")[2]
            source = file.with_name(f"{module}.py")
            jobs[job][name] = Drawing(place=place, source=source, **entry)
    return jobs


#: Jobs that draw, and the figures of each job by name.
FIGURES = _drawings(Path(__file__).with_suffix(".toml"), "hopdata.figures")
for product in products.installed():
    if product.catalogue.is_file():
        FIGURES |= _drawings(product.catalogue, f"{product.package}.figures")


@cache
def of_packages() -> dict[str, EntryPoint]:
    """Return the figures of installed packages (``hopdata.figures``), by name.

    Each is a function that takes the contents of its ``files`` and returns a figure.
    """
    own = {
        re.sub(r"^fig\d_\d_", "", name) for names in FIGURES.values() for name in names
    }
    return plugins("hopdata.figures", "figure", own)


def drawn_by_package(entry: EntryPoint, content: Callable[[str], Any]) -> Any:
    """Return the figure of another package, whose errors are told as its own.

    Parameters
    ----------
    entry : EntryPoint
        One of `of_packages`.
    content : callable
        Takes the path of a file of the results, and returns what is in it.
    """
    with blamed(name_of("figure", entry), entry.name):
        draw = entry.load()
        files = getattr(draw, "files", ())
    contents = [content(file) for file in files]
    with blamed(name_of("figure", entry), entry.name):
        return draw(*contents)


def tables_of(name: str, *, simulated: bool = False) -> tuple[str, ...]:
    """Return the files that a figure is drawn from, relative to the results."""
    drawing = _drawing(name)
    if simulated:
        return (*drawing.files, *drawing.truth)
    return tuple(drawing.files)


def source_of(name: str) -> Path:
    """Return the module that draws a figure."""
    return _drawing(name).source


def function_of(name: str) -> partial[Any]:
    """Return the function that draws a figure, with its options."""
    drawing = _drawing(name)
    return partial(resolve_name(drawing.place), **drawing.options)


def _drawing(name: str) -> Drawing:
    return next(drawings[name] for drawings in FIGURES.values() if name in drawings)
