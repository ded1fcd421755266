"""What the report is made from: plain data, and figures with their captions."""

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

# Captions: short texts beside the workflow, whose numbers are filled in from the tables.

PERCENT = re.compile(r"(?<=\d) %")
SPACES = re.compile(r"[ \t\n]+")  # a no-break space between number and unit stays


@dataclass(frozen=True)
class Caption:
    """A caption ready to print: its title, its paragraphs and a text for those who cannot see."""

    title: str
    paragraphs: tuple[str, ...]
    alt: str


def render_caption(template: str, facts: Mapping[str, Any], *, name: str) -> Caption:
    """Fill in a caption.

    Parameters
    ----------
    template : str
        Jinja text: a line ``# Title``, then paragraphs; one that begins with ``Alt:`` describes
        the picture for those who cannot see it.
    facts : mapping
        As given by `hopdata.report.page.study_facts`.
    name : str
        Name of the figure: the title and alternative text of a caption that has none, and the
        place in error messages.

    Raises
    ------
    ConfigError
        If the caption names a fact that does not exist, or is not valid Jinja.
    """
    from jinja2 import Environment, StrictUndefined, TemplateError

    environment = Environment(undefined=StrictUndefined, autoescape=False, trim_blocks=True)
    try:
        text = environment.from_string(template).render(facts)
    except TemplateError as error:
        raise ConfigError(f"caption of {name}: {error}") from error
    blocks = [_tidied(block) for block in text.split("\n\n") if block.strip()]
    titles = [block[1:].strip() for block in blocks if block.startswith("#")]
    alts = [block.removeprefix("Alt:").strip() for block in blocks if block.startswith("Alt:")]
    body = tuple(block for block in blocks if not block.startswith(("#", "Alt:")))
    title = titles[0] if titles else name
    return Caption(title=title, paragraphs=body, alt=alts[0] if alts else title)


def _tidied(block: str) -> str:
    """Make one line of a paragraph, in which no line break parts a number from its per cent."""
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
        SVG, PNG or GIF; empty if the figure was made in neither format.
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
    """What every page shows. Only `study` must be there; what is missing is said.

    Parameters
    ----------
    study : str
        Name of the study.
    figures : sequence of ReportFigure
        In the order in which they are shown; an animation is a figure of media type ``image/gif``.
    truth : mapping, optional
        Contents of ``truth.json``: name to ``value, unit, what``; empty or None for recordings of
        the real world.
    provenance : mapping, optional
        As from `hopdata.provenance.provenance`.
    notes : sequence
        What could not be done, each a sentence or a mapping with ``what`` and ``reason``.
    """

    study: str
    figures: Sequence[ReportFigure] = ()
    truth: Mapping[str, Mapping[str, Any]] | None = None
    provenance: Mapping[str, Any] | None = None
    notes: Sequence[str | Mapping[str, Any]] = ()


@dataclass(frozen=True)
class SteeringInputs(PageInputs):
    """What the page of the steering shows besides.

    Parameters
    ----------
    outcomes, horizons : DataFrame, optional
        ``outcomes.csv``, ``horizons.csv``.
    counts : sequence of mappings, optional
        ``observed.json``: by recording the frames, stances and hops, and what was left out.
    scores : DataFrame, optional
        ``model_scores.csv``.
    """

    outcomes: pd.DataFrame | None = None
    horizons: pd.DataFrame | None = None
    counts: Sequence[Mapping[str, Any]] | None = None
    scores: pd.DataFrame | None = None


@dataclass(frozen=True)
class ReportInputs(PageInputs):
    """What the page of a study shows besides.

    Parameters
    ----------
    recordings : sequence of mappings
        One a recording: ``name`` and any of ``source, n_frames, duration_s, rate_hz, n_feet,
        n_body, seen`` (share of the marker positions that were seen).
    touchdowns : DataFrame, optional
        The touchdown table of the study, excluded ones included.
    filled : DataFrame, optional
        ``filled.csv``, where gaps were filled: gaps of every marker, and what was filled of them.
    sections, units : mapping, optional
        Contents of ``sections.json``, ``units.json``.
    levelled : sequence of Recording
        Of which landings are shown in 3-D and in small plots; none without them.
    floors : mapping
        Recording name to the floor model's JSON.
    prediction, distances : DataFrame, optional
        ``prediction_summary.csv`` and ``distance_summary.csv``.
    verdict : mapping, optional
        Contents of ``verdict.json``.
    overlay : mapping
        Tables of the contacts known from elsewhere, by name (``contact_overlay``,
        ``contact_overlay_summary``, ``contact_overlay_thresholds``); empty where none are.
    quality : sequence of mappings, optional
        Contents of ``quality.json``: checks with ``what, value, unit, good, poor, status, remark``.
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
    verdict: Mapping[str, Any] | None = None
    overlay: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    quality: Sequence[Mapping[str, Any]] | None = None
    faults: pd.DataFrame | None = None
    remarks: pd.DataFrame | None = None


def describe_recording(recording: Recording) -> dict[str, Any]:
    """Describe a recording for the page: where from, how long, how many markers, how much seen."""
    time = recording.time
    return {
        "name": recording.name,
        "source": ", ".join(Path(part).name for part in recording.source.split(", ")),
        "n_frames": len(time),
        "duration_s": float(time[-1] - time[0]) if len(time) else 0.0,
        "rate_hz": recording.rate_hz,
        "n_feet": len(recording.names("foot")),
        "n_body": len(recording.names("body")),
        "seen": float(np.isfinite(recording.positions).all(axis=2).mean()) if len(time) else None,
    }


def read_figures(
    images: Iterable[str | Path], captions: Iterable[str | Path]
) -> list[ReportFigure]:
    """Read figures and the captions that bear their names; of several formats SVG is taken.

    Parameters
    ----------
    images : paths
        Figure files of any format; several of one name are one figure.
    captions : paths
        Caption templates, ``<name>.md``.

    Returns
    -------
    list of ReportFigure
        In the order in which the names first appear among `images`.
    """
    texts = {Path(path).stem: Path(path).read_text(encoding="utf-8") for path in captions}
    files: dict[str, dict[str, Path]] = {}
    for path in map(Path, images):
        files.setdefault(path.stem, {})[path.suffix] = path
    figures = []
    for name, formats in files.items():
        suffix = next((s for s in MEDIA_TYPES if s in formats), "")
        image = formats[suffix].read_bytes() if suffix else b""
        figures.append(ReportFigure(name, image, MEDIA_TYPES.get(suffix, ""), texts.get(name, "")))
    return figures


# Figures as a page needs them: the image within the text, its size on paper, its caption.

DOUBLE_COLUMN_PT = 496.0


@dataclass(frozen=True)
class Picture:
    """A figure as the template needs it; `width_pt` is its size on paper."""

    source: str
    width_pt: float
    caption: Caption


def picture_of(figure: ReportFigure, facts: Mapping[str, Any]) -> Picture:
    """Fill in the caption and put the image into a URL.

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
    # The width on paper that an SVG asks for; a full text width for anything else.
    found = re.search(rb'<svg[^>]*?\swidth="([0-9.]+)pt"', figure.image[:4000])
    return Picture(source, float(found.group(1)) if found else DOUBLE_COLUMN_PT, caption)


def placed_pictures(
    figures: Iterable[ReportFigure], facts: Mapping[str, Any], places: Mapping[str, str], other: str
) -> dict[str, list[Picture]]:
    """Return pictures by the section of the page that they stand in."""
    placed: dict[str, list[Picture]] = {place: [] for place in (*places.values(), other)}
    for figure in figures:
        placed[places.get(figure.name, other)].append(picture_of(figure, facts))
    return placed


# Templates: where they are, and how they are filled in.

TEMPLATES = Path(__file__).with_name("templates")


def rendered(template: str, **content: Any) -> str:
    """Return a page: a complete HTML document, its style inside."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    names = ("report.css", "fold.js", "scene.js")
    style, fold, turn = ((TEMPLATES / name).read_text(encoding="utf-8") for name in names)
    scripts = {"fold": fold + turn if content.get("scene") else fold}
    return environment.get_template(template).render(**content, **scripts, style=style)


def as_yaml(config: Any) -> str:
    """Write a configuration as YAML; nothing for none."""
    import yaml

    return yaml.safe_dump(config, sort_keys=False, allow_unicode=True) if config else ""
