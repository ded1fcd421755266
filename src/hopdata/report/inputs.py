"""Inputs of the report: plain data, and figures with their captions."""

from __future__ import annotations

import base64
import hashlib
import re
import secrets
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hopdata import __version__
from hopdata.arrays import pd
from hopdata.errors import NO_BREAK_SPACES, ConfigError, printable
from hopdata.messages import ENGLISH, Message
from hopdata.recording import Recording
from hopdata.report.formatting import NO_BREAK_SPACE
from hopdata.report.language import said, sentence

# Captions: short texts in the workflow's folder, with numbers filled in from the
# tables.

PERCENT = re.compile(r"(?<=\d) %")
# A blank between a number and its unit.
BEFORE_UNIT = re.compile(r"(?<=\d) (?=(?:%|mm|ms|s|m|m/s|Hz|N|kg|°)(?![\w/]))")
# Words in backquotes, as in Markdown.
CODE = re.compile("`([^`]+)`")
# Not the no-break space between a number and its unit.
SPACES = re.compile(r"[ \t\n]+")


@dataclass(frozen=True)
class Caption:
    """A caption ready to print: title, paragraphs, and text in place of the picture."""

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
    titles = []
    alts = []
    paragraphs = []
    for block in blocks:
        if block.startswith("#"):
            titles.append(block[1:].strip())
        elif block.startswith("Alt:"):
            alts.append(block.removeprefix("Alt:").strip())
        else:
            paragraphs.append(block)
    title = titles[0] if titles else name
    alt = alts[0] if alts else title
    return Caption(title=title, paragraphs=tuple(paragraphs), alt=alt)


def _tidied(block: str) -> str:
    """Join a paragraph to one line, with no-break spaces before units."""
    line = SPACES.sub(" ", block).strip()
    return BEFORE_UNIT.sub(NO_BREAK_SPACE, line)


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
    """Contents common to all pages, of which only `study` is required.

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
    language : str
        Language of the page; what is not translated is said in English.
    """

    study: str
    figures: Sequence[ReportFigure] = ()
    truth: Mapping[str, Mapping[str, Any]] | None = None
    provenance: Mapping[str, Any] | None = None
    notes: Sequence[str | Mapping[str, Any]] = ()
    language: str = ENGLISH


@dataclass(frozen=True)
class ReportInputs(PageInputs):
    """Further contents of a study's page.

    Parameters
    ----------
    recordings : sequence of mappings
        One per recording: ``name`` and any of ``source, n_frames, duration_s, rate_hz,
        n_feet, n_body, seen`` (markers of the feet and of the body; fraction of the
        marker positions that were seen).
    touchdowns : DataFrame, optional
        The study's table of touchdowns, including excluded ones.
    lags : DataFrame, optional
        ``lags.csv``: the lags of each two feet in the touchdowns used.
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
        ``contact_overlay_summary``, ``contact_overlay_thresholds``,
        ``contact_overlay_notes``); empty if there are none.
    quality : sequence of mappings, optional
        Contents of ``quality.json``: checks with ``what, value, unit, good, poor,
        status, remark``.
    faults : DataFrame, optional
        ``faults.csv``.
    remarks : DataFrame, optional
        ``remarks.csv``.
    simulated : bool
        Whether the recordings are known to be simulated though no truth is given.
    one_or_own : DataFrame, optional
        ``one_or_own.csv``: landings foretold by one map and by maps of their orders.
    settings : mapping, optional
        The keys of the configuration that differ from their defaults; if they are not
        known, the page shows the whole configuration.
    """

    recordings: Sequence[Mapping[str, Any]] = ()
    touchdowns: pd.DataFrame | None = None
    lags: pd.DataFrame | None = None
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
    simulated: bool = False
    one_or_own: pd.DataFrame | None = None
    settings: Mapping[str, Any] | None = None


def joined_feet(provenance: Mapping[str, Any] | None) -> dict[str, tuple[str, ...]]:
    """Return the markers of each foot that a study joins from several, by its name."""
    feet = ((provenance or {}).get("config") or {}).get("feet") or ()
    return {str(foot["name"]): tuple(foot["markers"]) for foot in feet}


def count_feet(recording: Mapping[str, Any], provenance: Any = None) -> int | None:
    """Return how many feet a recording has; markers of one foot count once.

    Parameters
    ----------
    recording : mapping
        One of `ReportInputs.recordings`, whose ``n_feet`` counts markers.
    provenance : mapping, optional
        From which `joined_feet` are known.
    """
    n_markers = recording.get("n_feet")
    if n_markers is None:
        return None
    further = [len(markers) - 1 for markers in joined_feet(provenance).values()]
    return int(n_markers) - sum(further)


def describe_recording(recording: Recording) -> dict[str, Any]:
    """Describe a recording for the page: source, duration, markers, fraction seen."""
    time = recording.time
    duration_s = 0.0
    seen = None
    if len(time):
        duration_s = float(time[-1] - time[0])
        seen = float(np.isfinite(recording.positions).all(axis=2).mean())
    return {
        "name": recording.name,
        "source": ", ".join(Path(part).name for part in recording.source.split(", ")),
        "n_frames": len(time),
        "duration_s": duration_s,
        "rate_hz": recording.rate_hz,
        "n_feet": len(recording.names("foot")),
        "n_body": len(recording.names("body")),
        "seen": seen,
    }


def read_figures(
    images: Iterable[str | Path], captions: Iterable[str | Path]
) -> list[ReportFigure]:
    """Read figures, and captions of the same names; of several formats, SVG.

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
    texts = {}
    for path in map(Path, captions):
        texts[path.stem] = path.read_text(encoding="utf-8")
    files: dict[str, dict[str, Path]] = {}
    for path in map(Path, images):
        files.setdefault(path.stem, {})[path.suffix] = path
    figures = []
    for name, formats in files.items():
        image = b""
        media_type = ""
        for suffix, kind in MEDIA_TYPES.items():
            if suffix in formats:
                image = formats[suffix].read_bytes()
                media_type = kind
                break
        figures.append(ReportFigure(name, image, media_type, texts.get(name, "")))
    return figures


# Figures for the page: the image within the text, its size on paper, its caption.

# Width of the text of a paper.
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
    width_pt = DOUBLE_COLUMN_PT
    found = re.search(rb'<svg[^>]*?\swidth="([0-9.]+)pt"', figure.image[:4000])
    if found:
        width_pt = float(found.group(1))
    return Picture(source, width_pt, caption)


def placed_pictures(
    figures: Iterable[ReportFigure],
    facts: Mapping[str, Any],
    places: Mapping[str, str],
    other: str,
) -> dict[str, list[Picture]]:
    """Return pictures by the section of the page they belong to."""
    placed: dict[str, list[Picture]] = {other: []}
    for place in places.values():
        placed[place] = []
    for figure in figures:
        place = places.get(figure.name, other)
        placed[place].append(picture_of(figure, facts))
    return placed


# Templates: where they are, and how they are rendered.

TEMPLATES = Path(__file__).with_name("templates")


def rendered(
    template: str,
    *,
    own: Path | None = None,
    language: str = ENGLISH,
    **content: Any,
) -> str:
    """Return a page: a complete HTML document that includes its style.

    In a template ``say("name")`` is a sentence of ``messages.toml``, and the filter
    ``said`` puts a message or a word into the language of the page.

    Parameters
    ----------
    template : str
        Name of the template's file.
    own : path, optional
        A folder with further templates, of a product.
    language : str
        Language of the page.
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
        finalize=_shown,
    )
    environment.globals["version"] = __version__
    environment.globals["say"] = partial(sentence, language=language)
    environment.filters["said"] = partial(said, language=language)
    environment.filters["verbatim"] = _verbatim
    environment.filters["coded"] = _coded
    style = (TEMPLATES / "report.css").read_text(encoding="utf-8")
    scripts = (TEMPLATES / "fold.js").read_text(encoding="utf-8")
    if content.get("scene"):
        scripts += (TEMPLATES / "scene.js").read_text(encoding="utf-8")
    # Nobody who wrote a name that is on the page can know this word.
    placeholder = secrets.token_hex()
    page = environment.get_template(template).render(
        **content, language=language, fold=scripts, style=style, nonce=placeholder
    )
    return _with_policy(page, placeholder)


CHARSET = '<meta charset="utf-8">'
_WIDTH = re.compile(r'style="(--paper: [0-9.]+pt)"')


def _with_policy(page: str, placeholder: str) -> str:
    """Return a page with a policy: only its own scripts and styles, and nothing loaded.

    Should a name from a file ever reach the page as HTML, a browser would not run it.
    The scripts and styles of the templates bear a nonce, a digest of the page, so the
    same content makes the same page. The widths of pictures, which are attributes, are
    allowed by their own digests.
    """
    digest = hashlib.sha256(page.replace(placeholder, "").encode()).hexdigest()[:32]
    widths = []
    for rule in sorted(set(_WIDTH.findall(page))):
        of_rule = base64.b64encode(hashlib.sha256(rule.encode()).digest()).decode()
        widths.append(f"'sha256-{of_rule}'")
    styles = [f"'nonce-{digest}'"]
    if widths:
        styles += ["'unsafe-hashes'", *widths]  # only those of attributes
    policy = "; ".join(
        [
            "default-src 'none'",
            f"script-src 'nonce-{digest}'",
            f"style-src {' '.join(styles)}",
            "img-src data:",
            "base-uri 'none'",
            "form-action 'none'",
        ]
    )
    meta = f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
    if page.count(CHARSET) != 1:
        raise ValueError(f"expected one {CHARSET} in the template, for the policy")
    return page.replace(placeholder, digest).replace(CHARSET, f"{CHARSET}\n{meta}")


def _shown(value: Any) -> Any:
    """Return what a template shows without characters that nobody sees.

    A number and its unit stay on one line, except in what is to be copied:
    see `_verbatim`.
    """
    if isinstance(value, Message):
        value = str(value)
    if isinstance(value, str) and not hasattr(value, "__html__"):
        shown = printable(value, keep=f"\n\t{NO_BREAK_SPACES}")
        return BEFORE_UNIT.sub(NO_BREAK_SPACE, shown)
    return value


def _verbatim(text: str) -> Any:
    """Return a text with the blanks that it has, for what readers copy."""
    from markupsafe import escape

    return escape(printable(text, keep=f"\n\t{NO_BREAK_SPACES}"))


def _coded(text: Any) -> Any:
    """Return a text whose words in backquotes are set as code."""
    from markupsafe import Markup, escape

    return Markup(CODE.sub(r"<code>\1</code>", str(escape(_shown(str(text))))))


def as_yaml(config: Any) -> str:
    """Return a configuration as YAML; empty if there is none."""
    import yaml

    if not config:
        return ""
    return yaml.safe_dump(config, sort_keys=False, allow_unicode=True)
