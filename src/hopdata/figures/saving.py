"""Figures to files: the same data give the same bytes, and all formats are written or none."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata.errors import ConfigError, did_you_mean
from hopdata.figures.style import style_context
from hopdata.jobs import whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# A date or a library version in the file would change its bytes without a change of the data.
METADATA: Mapping[str, Mapping[str, str | None]] = {
    "svg": {"Date": None, "Creator": "hopdata"},
    "png": {"Software": "hopdata"},
    "pdf": {"CreationDate": None, "Creator": "hopdata", "Producer": "hopdata"},
}
DECIMALS = 9  # of a place, in parts of the figure


def save_figure(
    figure: Figure,
    path: str | os.PathLike[str],
    *,
    formats: Sequence[str] = ("svg", "png"),
    dpi: float = 200.0,
) -> tuple[Path, ...]:
    """Write a figure in several formats, all or none.

    Parameters
    ----------
    figure : Figure
        As returned by the functions of this package.
    path : path
        Name without suffix; ``.svg``, ``.png`` or ``.pdf`` is added.
    formats : sequence of str
        Any of ``"svg"``, ``"png"``, ``"pdf"``.
    dpi : float
        Pixels per inch of a PNG, and of the rasterised parts of the others.

    Returns
    -------
    tuple of Path
        The files written, in the order of `formats`.

    Raises
    ------
    ConfigError
        If a format is not one of the three, or `dpi` is not positive.
    """
    _check(formats, dpi)
    base = Path(path)
    targets = tuple(base.with_name(f"{base.name}.{suffix}") for suffix in formats)
    with ExitStack() as whole, style_context(), _laid_out(figure):
        for target, suffix in zip(targets, formats, strict=True):
            draft = whole.enter_context(whole_file(target))
            metadata: dict[str, Any] = dict(METADATA[suffix])
            figure.savefig(draft, format=suffix, dpi=dpi, metadata=metadata)
    return targets


@contextmanager
def _laid_out(figure: Figure) -> Iterator[None]:
    """Lay the figure out once for all formats, not once in each.

    Without an engine, and a style that asks for one, matplotlib draws once to save a format; with
    one it draws twice.
    """
    import matplotlib

    engine = figure.get_layout_engine()
    if engine is not None and figure.axes:
        engine.execute(figure)
        _round_positions(figure)
    with matplotlib.rc_context({"figure.constrained_layout.use": False}):
        figure.set_layout_engine(None)
        try:
            yield
        finally:
            figure.set_layout_engine(engine)


def _round_positions(figure: Figure) -> None:
    """Round the places of the axes: the last bits of a layout differ from process to process.

    In an SVG they would show in the names of clip paths, which are digests of their numbers.
    """
    for axes in figure.axes:
        is_in_layout = axes.get_in_layout()
        left, bottom, width, height = (
            round(value, DECIMALS) for value in axes.get_position(original=True).bounds
        )
        axes.set_position((left, bottom, width, height))
        axes.set_in_layout(is_in_layout)  # which `set_position` takes it out of


def _check(formats: Sequence[str], dpi: float) -> None:
    for name in formats:
        if name not in METADATA:
            raise ConfigError(
                f"figures.formats: expected one of {', '.join(METADATA)}, found '{name}'"
                f"{did_you_mean(name, METADATA)}"
            )
    if not dpi > 0:
        raise ConfigError(f"figures.dpi: expected a positive number, found {dpi}")
