"""Users' names in a small study: files, tables, figures, page, configuration."""

import csv
import json
import warnings
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser

import pandas as pd
import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from matplotlib.text import Text

from hopdata.commands.init import Draft, draft_config
from hopdata.config.loading import load_config
from hopdata.errors import ConfigError, RecordingError, printable
from hopdata.figures.overlay import contact_overlay_figure
from hopdata.figures.quality import recording_gaps_figure
from hopdata.figures.schedule import schedule_figure
from hopdata.figures.style import (
    label_of,
    paper_figure,
    save_figure,
    style_context,
    styled,
)
from hopdata.jobs import guarded, read_table, write_table
from hopdata.landings.contacts.velocity_minimum import example_touchdown
from hopdata.landings.external_truth import overlay_external_truth
from hopdata.landings.floor import fit_floor, level
from hopdata.landings.sections.select import select_sections
from hopdata.landings.states.assemble import assemble_pairs
from hopdata.landings.touchdowns import touchdown_table
from hopdata.recordings.importing import import_recording
from hopdata.recordings.quality.inspection import recording_tables
from hopdata.recordings.readers.hdf5 import read_recording, write_recording
from hopdata.report.inputs import ReportInputs, describe_recording
from hopdata.report.page import build_report

FRAMES = 600
FORMULA = tuple("=+-@\t\r")
NASTY = (
    *(
        "{x}",
        "{0}",
        "$\\frac{$",
        "$x$",
        "<b>%s</b>",
        '"',
        "'",
        "&amp;",
        "%",
        "\\",
        "a,b",
        "a: b",
    ),
    *(
        "=1+1",
        "'=1+1",
        "+a",
        "-a",
        "@a",
        "''@",
        "_a",
        "#",
        ".5",
        "1e3",
        "yes",
        "null",
        "NA",
        "~",
    ),
    *(
        "Fuß",
        "鹿",
        "🦌",
        "a b",
        " a",
        "x" * 80,
        "{{ x }}",
        "</pre><script>",
        "--",
        "]]>",
        "a%sb",
    ),
)
names = st.one_of(
    st.sampled_from(NASTY),
    st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12).filter(
        lambda name: name.isprintable() and name.strip()
    ),
)
seven = st.lists(names, min_size=7, max_size=7, unique=True)


@pytest.fixture(scope="module")
def piece(sample_path):
    """Return a few landings of the sample, with a gap in the third body marker."""
    recording = read_recording(sample_path).part(slice(0, FRAMES))
    recording.positions[100:110, 2] = float("nan")
    return recording


def stages(recording, folder, home):
    """Return the tables of a study that contain names, written and read back as its jobs do."""
    floored = level(recording, fit_floor(recording, degree=0))
    sections = select_sections([floored])
    heights = {key: getattr(sections, key) for key in ("pre_height_m", "post_height_m")}
    table = touchdown_table(floored, **heights, method="velocity_minimum")
    write_table(folder / "touchdowns.csv", table)
    table = read_table(folder / "touchdowns.csv")
    assemble_pairs([floored], table, **heights, home_marker=home)
    known = table[[f"contact_{foot}_s" for foot in recording.names("foot")]]
    known.to_csv(folder / "known.csv", index=False, header=["a", "b", "c"])
    columns = [
        {"name": n, "feet": [f]}
        for n, f in zip("abc", recording.names("foot"), strict=True)
    ]
    block = {
        "file": str(folder / "known.csv"),
        "columns": columns,
        "unit": "s",
        "offset_s": 0.0,
    }
    block |= {"label_column": None, "time_column": None}
    configured = {recording.name: {"contacts": block, "forces": {"file": None}}}
    overlay = overlay_external_truth([floored], table, configured, window_s=0.05)
    tables = {
        **recording_tables([recording]),
        "touchdowns": table,
        "example": example_touchdown([floored], table),
        "contacts": overlay.contacts,
        "summary": overlay.summary,
        "landing": overlay.example,
    }
    return {
        name: through_a_file(folder / f"{name}.csv", one)
        for name, one in tables.items()
    }


def through_a_file(path, table):
    """Write a table, check that no cell of it is a formula, and read it back unchanged."""
    write_table(path, table)
    with path.open(newline="", encoding="utf-8") as file:
        cells = [cell for row in csv.reader(file) for cell in row]
    assert not [
        cell for cell in cells if cell.startswith(FORMULA) and not is_number(cell)
    ]
    back = read_table(path)
    assert list(back) == list(table)
    for column in table:
        texts = table[column].map(lambda cell: cell if isinstance(cell, str) else "")
        if texts.any():
            assert back[column].fillna("").tolist() == texts.tolist()
    return back


def is_number(cell):
    try:
        float(cell)
    except ValueError:
        return False
    return True


def figures(tables):
    yield schedule_figure(tables["example"], tables["touchdowns"])
    yield recording_gaps_figure(tables["markers"], tables["gaps"], tables["faults"])
    yield contact_overlay_figure(
        tables["contacts"], tables["summary"], tables["landing"]
    )


class Texts(HTMLParser):
    """Tags and cells of a page."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.cells = set(), [""]
        self.feed(page)

    def handle_starttag(self, tag, _attributes):
        self.tags.add(tag)
        self.cells.append("")

    def handle_endtag(self, _tag):
        self.cells.append("")

    def handle_data(self, data):
        self.cells[-1] += data


def imported(piece, folder, names):
    """Return the recording of a file with these names, by the configuration that `init` drafts."""
    markers = {"body": names[:3], "feet": names[3:6], "boom": names[6:]}
    write_recording(folder / "file.h5", replace(piece, markers=tuple(names)))
    file = str(folder / "file.h5")
    draft = Draft("mine", file, [("monday", file)], markers, all_markers=names)
    (folder / "study.yaml").write_text(
        draft_config(draft, path="x.yaml"), encoding="utf-8"
    )
    config = load_config(folder / "study.yaml")
    assert config["markers"] == markers
    recording, _ = import_recording(
        folder / "file.h5", name="monday", markers=config["markers"]
    )
    assert recording.markers == tuple(names)
    return recording, config


@settings(
    max_examples=8,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@example(list(NASTY[:7]))
@example(list(NASTY[12:19]))
@given(seven)
def test_any_names_come_through_a_study(piece, tmp_path, names):
    recording, config = imported(piece, tmp_path, names)
    tables = stages(recording, tmp_path, config["home"]["marker"])
    page = build_report(
        ReportInputs(
            study="mine",
            recordings=[describe_recording(recording)],
            touchdowns=tables["touchdowns"],
            overlay={"contact_overlay_summary": tables["summary"]},
            faults=tables["faults"],
            notes=names,
            provenance=json.loads(json.dumps({"config": config})),
        )
    )
    found = Texts(page)
    assert "b" not in found.tags
    assert page.count("<script") == 1  # the page's own
    assert set(names) <= set(found.cells)


@pytest.mark.parametrize("names", [NASTY[:7], (*NASTY[12:18], "🦌")])
def test_figures_show_any_names_as_they_are(piece, tmp_path, names):
    recording, config = imported(piece, tmp_path, list(names))
    tables = stages(recording, tmp_path, config["home"]["marker"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for figure in figures(tables):
            (svg,) = save_figure(figure, tmp_path / "figure", formats=("svg",))
            ET.parse(svg)


@styled
def figure_of(name):
    """Return a figure with a name in every kind of text."""
    figure = paper_figure(60, 60)
    axes = figure.subplots()
    axes.semilogy([1, 2], [1e-3, 1e2], label=name)
    axes.set(title=name, xlabel=name, xticks=[1, 2], xticklabels=[name, name])
    axes.annotate(name, (1, 1))
    figure.suptitle(name)
    figure.legend()
    figure.legend(*axes.get_legend_handles_labels(), title=name)
    return figure


@settings(max_examples=15, deadline=None, derandomize=True)
@example("$\\frac{$")
@given(names)
def test_no_text_of_a_figure_is_read_as_mathematics(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = figure_of(label_of(name))
        with style_context():
            figure.canvas.draw()
    texts = [text for text in figure.findobj(Text) if text.get_text()]
    assert sum(text.get_text() == label_of(name) for text in texts) >= 8
    assert not any(text.get_parse_math() for text in texts)
    assert "10⁻²" in [text.get_text() for text in figure.axes[0].get_yticklabels()]


@settings(deadline=None, derandomize=True)
@given(
    st.lists(st.text(st.characters(exclude_categories=["C"]), max_size=9), min_size=1)
)
def test_texts_of_tables_come_back_and_are_no_formulas(tmp_path_factory, texts):
    table = pd.DataFrame({"name": texts, "x_m": range(len(texts))})
    through_a_file(tmp_path_factory.getbasetemp() / "texts.csv", table)


@settings(deadline=None, derandomize=True)
@given(names)
def test_a_draft_quotes_what_must_be_quoted(name):
    markers = {"body": [name, "b2", "b3"], "feet": ["f1", "f2"]}
    draft = Draft(
        "mine",
        "a.tsv",
        [("monday", name)],
        markers,
        {"markers.body": name},
        remarks=[name],
        all_markers=[name],
    )
    written = yaml.safe_load(draft_config(draft, path=name))
    assert (written["markers"], written["recordings"][0]["file"]) == (markers, name)


@pytest.mark.parametrize("name", ["a\nb", "a\x1b[2Jb", "a\u2028b"])
def test_a_name_that_no_line_can_hold_is_told_in_one(piece, tmp_path, name):
    write_recording(
        tmp_path / "a.h5", replace(piece, markers=(name, *piece.markers[1:]))
    )
    with pytest.raises(RecordingError, match=r"a\.h5: .*marker 1, found") as caught:
        import_recording(tmp_path / "a.h5", name="a", markers={"body": [name]})
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("name", ["a\n", "a/b", "{a}", "a" * 101, "-a", "", "é", "a*"])
@pytest.mark.parametrize("key", ["study", "name"])
def test_names_of_paths_are_plain(key, name):
    config = {
        "study": "mine",
        "recordings": [{"name": "monday"}],
        "markers": {
            "body": ["body1", "body2", "body3"],
            "feet": ["foot1", "foot2", "foot3"],
        },
    }
    (config if key == "study" else config["recordings"][0])[key] = name
    with pytest.raises(ConfigError, match=r"expected text .letters, digits") as caught:
        load_config(config)
    assert str(caught.value).isprintable()


def test_labels_are_short_and_no_legend_hides_them():
    assert label_of("_a") == " _a"
    assert label_of("a\n\tb\x00") == "a b"
    assert len(label_of("x" * 80)) == 24


@pytest.mark.parametrize(
    "name",
    ["müde", "左足", "нога", "رِجْل", "पैर", "می\u200cخواهم", "क्\u200dष", "🦶", "a - b'c"],
)
def test_letters_of_all_scripts_stay(name):
    assert printable(name) == name
    assert guarded(name) == name


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b[31mred\x1b[0m", "?[31mred?[0m"),
        ("\x1b]8;;http://a\x07b", "?]8;;http://a?b"),  # a link
        ("\x1b]52;c;aGk=\x07", "?]52;c;aGk=?"),  # the clipboard
        ("\x9b2J\x90q\x9c", "?2J?q?"),
        ("a\u202eb\u2066c\u200fd\u061c", "a?b?c?d?"),
        ("a\u200bb\ufeffc\u00add\u2060", "a?b?c?d?"),
        ("a\u200cb\u200d", "a?b?"),  # joiners between letters that none joins
        ("a\nb\rc\td\u2028e\x85f\x0bg", "a b c d e f g"),
        ("a\0b\ud800c\U000e0041d", "a?b?c?d"),
    ],
)
def test_what_nobody_sees_and_a_terminal_obeys_is_replaced(text, shown):
    assert printable(text) == shown
    assert guarded(text) == shown
    assert str(RecordingError(text)) == shown
