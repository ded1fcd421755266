"""Inputs of the report: plain data, and figures with their captions."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.arrays import pd
from hopdata.errors import ConfigError
from hopdata.recording import Recording
from hopdata.report.formatting import NO_BREAK_SPACE

# Captions: short texts in the workflow's folder, with numbers filled in from the
# tables.

PERCENT = re.compile(r"(?<=\d) %")
SPACES = re.compile(r"[ \t\n]+")  # not the no-break space between a number and its unit


@dataclass(frozen=True)
class Caption:
    """A caption ready to print: title, paragraphs, and alternative text for the picture."""

    title: str
    paragraphs: tuple[str, ...]
    alt: str


def render_caption(template: str, facts: Mapping[str, Any], *, name: str) -> Caption:
    """Fill in a caption.

    Parameters
    ----------
    template : str
        Jinja text: a line ``# Title``, then paragraphs; one that begins with ``Alt:``
        is the alternative text of the picture.
    facts : mapping
        From `hopdata.report.page.study_facts`.
    name : str
        Name of the figure: the default title and alternative text, and the place in
        error messages.

    Raises
    ------
    ConfigError
        If the caption names a fact that does not exist, or is not valid Jinja.
    """
    from jinja2 import Environment, StrictUndefined, TemplateError

    environment = Environment(
        undefined=StrictUndefined, autoescape=False, trim_blocks=True
    )
    try:
        text = environment.from_string(template).render(facts)
    except TemplateError as error:
        raise ConfigError(f"caption of {name}: {error}") from error
    blocks = [_tidied(block) for block in text.split("\n\n") if block.strip()]
    titles = [block[1:].strip() for block in blocks if block.startswith("#")]
    alts = [
        block.removeprefix("Alt:").strip()
        for block in blocks
        if block.startswith("Alt:")
    ]
    body = tuple(block for block in blocks if not block.startswith(("#", "Alt:")))
    title = titles[0] if titles else name
    return Caption(title=title, paragraphs=body, alt=alts[0] if alts else title)


def _tidied(block: str) -> str:
    """Join a paragraph to one line, with no-break spaces between numbers and per cent signs."""
    return PERCENT.sub(f"{NO_BREAK_SPACE}%", SPACES.sub(" ", block).strip())


MEDIA_TYPES = {".svg": "image/svg+xml", ".png": "image/png", ".gif": "image/gif"}


@dataclass(frozen=True)
class ReportFigure:
    """One figure of the report.

    Parameters
    ----------
    name : str
        Name of its file without suffix, such as ``fig2_2_sections``.
    image : bytes
        SVG, PNG or GIF; empty if the figure exists in none of these formats.
    media_type : str
        ``image/svg+xml``, ``image/png`` or ``image/gif``.
    caption : str
        Template of the caption, as in ``workflow/captions``.
    """

    name: str
    image: bytes
    media_type: str
    caption: str = ""


@dataclass(frozen=True)
class PageInputs:
    """Contents common to all pages. Only `study` is required; the page says what is missing.

    Parameters
    ----------
    study : str
        Name of the study.
    figures : sequence of ReportFigure
        In the order of the page; an animation is a figure of media type ``image/gif``.
    truth : mapping, optional
        Contents of ``truth.json``: name to ``value, unit, what``; empty or None for
        real recordings.
    provenance : mapping, optional
        From `hopdata.provenance.provenance`.
    notes : sequence
        Steps that could not be done, each a sentence or a mapping with ``what`` and
        ``reason``.
    """

    study: str
    figures: Sequence[ReportFigure] = ()
    truth: Mapping[str, Mapping[str, Any]] | None = None
    provenance: Mapping[str, Any] | None = None
    notes: Sequence[str | Mapping[str, Any]] = ()


@dataclass(frozen=True)
class ReportInputs(PageInputs):
    """Further contents of a study's page.

    Parameters
    ----------
    recordings : sequence of mappings
        One per recording: ``name`` and any of ``source, n_frames, duration_s, rate_hz,
        n_feet, n_body, seen`` (fraction of the marker positions that were seen).
    touchdowns : DataFrame, optional
        The study's table of touchdowns, including excluded ones.
    filled : DataFrame, optional
        ``filled.csv``: gaps of every marker, and how much of them was filled.
    sections, units : mapping, optional
        Contents of ``sections.json``, ``units.json``.
    levelled : sequence of Recording
        Recordings whose landings are shown in 3-D and in small plots; none if empty.
    floors : mapping
        The floor model's JSON by name of the recording.
    prediction, distances : DataFrame, optional
        ``prediction_summary.csv`` and ``distance_summary.csv``.
    distances_asked : bool
        Whether the study asks for distances; if not, the page says so in their place.
    verdict : mapping, optional
        Contents of ``verdict.json``.
    overlay : mapping
        Tables of the contacts known from other sources, by name (``contact_overlay``,
        ``contact_overlay_summary``, ``contact_overlay_thresholds``); empty if there are
        none.
    quality : sequence of mappings, optional
        Contents of ``quality.json``: checks with ``what, value, unit, good, poor,
        status, remark``.
    faults : DataFrame, optional
        ``faults.csv``.
    remarks : DataFrame, optional
        ``remarks.csv``.
    """

    recordings: Sequence[Mapping[str, Any]] = ()
    touchdowns: pd.DataFrame | None = None
    filled: pd.DataFrame | None = None
    sections: Mapping[str, Any] | None = None
    units: Mapping[str, Any] | None = None
    levelled: Sequence[Recording] = ()
    floors: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    prediction: pd.DataFrame | None = None
    distances: pd.DataFrame | None = None
    distances_asked: bool = True
    verdict: Mapping[str, Any] | None = None
    overlay: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    quality: Sequence[Mapping[str, Any]] | None = None
    faults: pd.DataFrame | None = None
    remarks: pd.DataFrame | None = None


def describe_recording(recording: Recording) -> dict[str, Any]:
    """Describe a recording for the page: source, duration, number of markers, fraction seen."""
    time = recording.time
    return {
        "name": recording.name,
        "source": ", ".join(Path(part).name for part in recording.source.split(", ")),
        "n_frames": len(time),
        "duration_s": float(time[-1] - time[0]) if len(time) else 0.0,
        "rate_hz": recording.rate_hz,
        "n_feet": len(recording.names("foot")),
        "n_body": len(recording.names("body")),
        "seen": float(np.isfinite(recording.positions).all(axis=2).mean())
        if len(time)
        else None,
    }


def read_figures(
    images: Iterable[str | Path], captions: Iterable[str | Path]
) -> list[ReportFigure]:
    """Read figures, and captions of the same names; SVG is preferred among several formats.

    Parameters
    ----------
    images : paths
        Figure files in any format; files of the same name are one figure.
    captions : paths
        Caption templates, ``<name>.md``.

    Returns
    -------
    list of ReportFigure
        In the order in which the names first appear in `images`.
    """
    texts = {
        Path(path).stem: Path(path).read_text(encoding="utf-8") for path in captions
    }
    files: dict[str, dict[str, Path]] = {}
    for path in map(Path, images):
        files.setdefault(path.stem, {})[path.suffix] = path
    figures = []
    for name, formats in files.items():
        suffix = next((s for s in MEDIA_TYPES if s in formats), "")
        image = formats[suffix].read_bytes() if suffix else b""
        figures.append(
            ReportFigure(name, image, MEDIA_TYPES.get(suffix, ""), texts.get(name, ""))
        )
    return figures


# Figures for the page: the image within the text, its size on paper, its caption.

DOUBLE_COLUMN_PT = 496.0


@dataclass(frozen=True)
class Picture:
    """A figure for the template; `width_pt` is its width on paper."""

    source: str
    width_pt: float
    caption: Caption


def picture_of(figure: ReportFigure, facts: Mapping[str, Any]) -> Picture:
    """Fill in the caption and encode the image as a data URL.

    Raises
    ------
    ConfigError
        If the caption names a fact that does not exist.
    """
    caption = render_caption(figure.caption, facts, name=figure.name)
    source = ""
    if figure.image:
        encoded = base64.b64encode(figure.image).decode("ascii")
        source = f"data:{figure.media_type};base64,{encoded}"
    # The SVG's own width on paper; the full text width for anything else.
    found = re.search(rb'<svg[^>]*?\swidth="([0-9.]+)pt"', figure.image[:4000])
    return Picture(
        source, float(found.group(1)) if found else DOUBLE_COLUMN_PT, caption
    )


def placed_pictures(
    figures: Iterable[ReportFigure],
    facts: Mapping[str, Any],
    places: Mapping[str, str],
    other: str,
) -> dict[str, list[Picture]]:
    """Return pictures by the section of the page they belong to."""
    placed: dict[str, list[Picture]] = {
        place: [] for place in (*places.values(), other)
    }
    for figure in figures:
        placed[places.get(figure.name, other)].append(picture_of(figure, facts))
    return placed


# Templates: where they are, and how they are rendered.

TEMPLATES = Path(__file__).with_name("templates")


def rendered(template: str, *, own: Path | None = None, **content: Any) -> str:
    """Return a page: a complete HTML document that includes its style.

    Parameters
    ----------
    template : str
        Name of the template's file.
    own : path, optional
        A folder with further templates, of a product.
    **content
        What the template shows.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    folders = [TEMPLATES]
    if own is not None:
        folders.append(own)
    environment = Environment(
        loader=FileSystemLoader(folders),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    names = ("report.css", "fold.js", "scene.js")
    style, fold, turn = (
        (TEMPLATES / name).read_text(encoding="utf-8") for name in names
    )
    scripts = {"fold": fold + turn if content.get("scene") else fold}
    return environment.get_template(template).render(**content, **scripts, style=style)


def as_yaml(config: Any) -> str:
    """Return a configuration as YAML; empty if there is none."""
    import yaml

    return yaml.safe_dump(config, sort_keys=False, allow_unicode=True) if config else ""
