import hashlib
import os

import matplotlib
import pandas as pd
import pytest
from fake_tables import (
    densities,
    distance_summary,
    distances,
    example,
    frames,
    prediction_summary,
    sections,
    touchdown,
    units,
)
from matplotlib.figure import Figure
from matplotlib.text import Text
from overlaps import text_faults
from PIL import Image, ImageChops

from hopdata.errors import ConfigError
from hopdata.figures.distances import distances_figure
from hopdata.figures.prediction import prediction_figure
from hopdata.figures.schedule import schedule_figure
from hopdata.figures.sections import sections_figure
from hopdata.figures.style import (
    FOOT_COLOURS,
    STYLES,
    TEXT_PT,
    WIDEST_PANEL_MM,
    foot_colour,
    foot_dash,
    message_figure,
    paper_figure,
    save_figure,
    style_context,
)
from hopdata.figures.verdict import plan_figure, verdict_figure


def test_size_on_paper_is_in_millimetres():
    assert paper_figure(85, 50).get_size_inches() * 25.4 == pytest.approx((85, 50))


def test_the_style_holds_within_and_only_there():
    matplotlib.get_backend()  # chosen at the first request, whoever makes it
    before = matplotlib.rcParams.copy()
    with style_context():
        assert matplotlib.rcParams["svg.hashsalt"] == "hopdata"
        assert matplotlib.rcParams["font.size"] == 7
    prediction_figure(prediction_summary(), units())
    assert matplotlib.rcParams == before


def test_a_users_own_settings_do_not_reach_the_figures():
    with matplotlib.rc_context({"axes.facecolor": "red", "font.size": 30}):
        figure = prediction_figure(prediction_summary(), units())
    assert figure.axes[0].get_facecolor() == (1, 1, 1, 1)
    assert figure.axes[0].yaxis.label.get_fontsize() == 7


def test_feet_differ_in_colour_and_in_dashes():
    assert len({foot_colour(i) for i in range(6)}) == len(FOOT_COLOURS) == 6
    assert len({foot_dash(i) for i in range(6)}) == 6
    assert foot_colour(6) == foot_colour(0)


def test_a_message_is_drawn_in_words():
    assert message_figure("nothing here").texts[0].get_text() == "nothing here"


def draw(name):
    if name == "sections":
        table, limits = frames(n=500), sections()
        return sections_figure(table, densities(table, limits), limits)
    if name == "schedule":
        row = touchdown()
        return schedule_figure(example(row), pd.DataFrame([row]))
    if name == "prediction":
        return prediction_figure(prediction_summary(), units())
    table = distances()
    return distances_figure(table, distance_summary(table))


@pytest.mark.parametrize("name", ["sections", "schedule", "prediction", "distances"])
def test_the_same_data_give_the_same_bytes(tmp_path, name):
    digests = []
    for folder in ("first", "second"):
        files = save_figure(draw(name), tmp_path / folder / name, dpi=100)
        digests.append([hashlib.sha256(path.read_bytes()).digest() for path in files])
    assert digests[0] == digests[1]


def test_other_data_give_other_bytes(tmp_path):
    one = save_figure(
        prediction_figure(prediction_summary(), units()), tmp_path / "one"
    )
    two = save_figure(
        prediction_figure(prediction_summary(("all",)), units()), tmp_path / "two"
    )
    assert one[0].read_bytes() != two[0].read_bytes()


def test_nothing_stays_of_a_process_that_was_killed_while_it_saved(
    tmp_path, monkeypatch
):
    def killed(self, draft, **options):
        draft.write_bytes(b"half")
        os._exit(9)

    figure = draw("prediction")
    if not (child := os.fork()):
        monkeypatch.setattr(Figure, "savefig", killed)
        save_figure(figure, tmp_path / "fig")
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
    assert len(list(tmp_path.iterdir())) == 1
    files = save_figure(figure, tmp_path / "fig")
    assert sorted(tmp_path.iterdir()) == sorted(files)


def test_files_formats_and_resolution(tmp_path):
    files = save_figure(
        draw("prediction"), tmp_path / "fig.v2", formats=("png", "svg"), dpi=100
    )
    assert [path.name for path in files] == ["fig.v2.png", "fig.v2.svg"]
    assert sorted(tmp_path.iterdir()) == sorted(files)
    with Image.open(files[0]) as image:
        assert image.width == pytest.approx(WIDEST_PANEL_MM / 25.4 * 100, abs=1)
    text = files[1].read_text()
    assert "<dc:date>" not in text
    assert "Matplotlib v" not in text


def test_the_scatter_is_rasterised(tmp_path):
    table, limits = frames(n=20000), sections()
    figure = sections_figure(table, densities(table, limits), limits)
    (path,) = save_figure(figure, tmp_path / "fig", formats=["svg"])
    assert "<image" in path.read_text()
    assert path.stat().st_size < 1e6


@pytest.mark.parametrize("options", [{"formats": ["svgg"]}, {"dpi": 0}])
def test_a_wrong_option_is_named_and_nothing_is_written(tmp_path, options):
    with pytest.raises(ConfigError, match="figures"):
        save_figure(draw("prediction"), tmp_path / "fig", **options)
    assert not list(tmp_path.iterdir())


def test_a_failure_midway_leaves_the_old_files(tmp_path, monkeypatch):
    figure = draw("prediction")
    save_figure(figure, tmp_path / "fig", formats=["svg"])
    old = (tmp_path / "fig.svg").read_bytes()
    write = figure.savefig

    def fail_on_png(path, *, format, **options):
        if format == "png":
            raise OSError("disk full")
        write(path, format=format, **options)

    monkeypatch.setattr(figure, "savefig", fail_on_png)
    figure.axes[0].set_title("changed")
    with pytest.raises(OSError, match="disk full"):
        save_figure(figure, tmp_path / "fig", formats=["svg", "png"])
    assert [path.name for path in tmp_path.iterdir()] == ["fig.svg"]
    assert (tmp_path / "fig.svg").read_bytes() == old


@pytest.mark.parametrize("name", ["sections", "schedule", "prediction", "distances"])
def test_laid_out_once_the_picture_is_matplotlibs_own(tmp_path, name):
    (ours,) = save_figure(draw(name), tmp_path / "ours", formats=["png"], dpi=100)
    own = tmp_path / "own.png"
    with style_context():
        draw(name).savefig(own, dpi=100)
    with Image.open(ours) as one, Image.open(own) as other:
        assert (
            ImageChops.difference(one.convert("RGB"), other.convert("RGB")).getbbox()
            is None
        )


def test_each_format_is_drawn_once_and_the_layout_is_kept(tmp_path, monkeypatch):
    figure, calls = draw("prediction"), []
    engine, whole = figure.get_layout_engine(), Figure.draw
    monkeypatch.setattr(Figure, "draw", lambda *args: calls.append(1) or whole(*args))
    save_figure(figure, tmp_path / "fig")
    assert len(calls) == 2
    assert figure.get_layout_engine() is engine
    save_figure(figure, tmp_path / "fig")
    assert len(calls) == 4


def test_a_figure_without_axes_is_saved(tmp_path, recwarn):
    assert len(save_figure(message_figure("nothing to draw"), tmp_path / "fig")) == 2
    assert not recwarn.list


def test_last_bits_of_a_place_do_not_show(tmp_path, monkeypatch):
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    execute = ConstrainedLayoutEngine.execute

    def nudged(self, figure):
        execute(self, figure)
        for axes in figure.axes:
            box = axes.get_position(original=True)
            axes._set_position((box.x0 + nudges[-1], *box.bounds[1:]), which="original")

    monkeypatch.setattr(ConstrainedLayoutEngine, "execute", nudged)
    texts, nudges = [], [0.0, 3e-16]
    while nudges:
        with style_context():
            figure = paper_figure(80, 60)
        figure.subplots(1, 2)[0].plot([0, 1, 3], [0, 2, 1])
        (file,) = save_figure(figure, tmp_path / "nudged", formats=("svg",))
        texts.append(file.read_text())
        nudges.pop()
    assert texts[0] == texts[1]


def whole_figures():
    yield lambda **o: prediction_figure(prediction_summary(), units(), **o)
    yield lambda **o: schedule_figure(
        example(touchdown()), pd.DataFrame([touchdown()]), **o
    )
    yield lambda **o: sections_figure(
        frames(), densities(frames(), sections()), sections(), **o
    )
    yield lambda **o: distances_figure(distances(), distance_summary(distances()), **o)


@pytest.mark.parametrize("name", STYLES)
def test_no_text_lies_over_another_in_any_journal(name):
    journal = STYLES[name]
    for draw in whole_figures():
        figure = draw(style=name)
        width_mm = round(figure.get_size_inches()[0] * 25.4, 1)
        panel_mm = round(WIDEST_PANEL_MM * journal.text, 1)
        assert width_mm in (journal.single_mm, panel_mm, journal.double_mm)
        assert text_faults(figure) == []


def test_a_figure_fills_the_users_axes_and_leaves_the_others():
    mine = Figure(figsize=(12, 5), layout="constrained")
    left, right = mine.subplots(1, 2)
    left.plot([0, 1])
    drawn = schedule_figure(example(touchdown()), pd.DataFrame([touchdown()]), ax=right)
    assert drawn in mine.subfigs
    assert len(drawn.axes) == 3
    assert left in mine.axes
    assert right not in mine.axes


def test_a_figure_with_one_axes_is_drawn_into_the_users_own():
    axes = Figure(figsize=(14, 10)).subplots()
    with matplotlib.rc_context({"font.size": 20}):
        assert plan_figure({0.1: 500, 0.2: 130}, (1000, 0.15), 0.8, ax=axes) is axes
    assert axes.get_ylabel().startswith("landings that show it")
    assert axes.texts[0].get_fontsize() == pytest.approx(20)  # the user's


EFFECT = {
    "estimate": 0.0,
    "low": 0.0,
    "high": 0.13,
    "upper_bound": 0.12,
    "detectable": 0.16,
}
VERDICT = {"conclusion": "no difference", "sentence": 12 * "words ", "effect": EFFECT}
VERDICT |= {"compared": "6 orders", "n_landings": 900}
VERDICT |= {"confidence": 0.95, "margin": 0.2, "power": 0.8}
ORDERS = pd.DataFrame({"schedule": ["2>1>3", "3>1>2", "1>2>3"], "excluded": False})


@pytest.mark.parametrize("size", [(14, 5), (7, 3)])
def test_in_places_of_any_size_text_fits(size):
    """Draw as docs/notebook.md does, in matplotlib's own style."""
    mine = Figure(figsize=size, layout="constrained")
    left, right = mine.subplots(1, 2)
    verdict_figure(VERDICT, ORDERS, ax=left)
    prediction_figure(prediction_summary(), units(), ax=right)
    assert text_faults(mine) == []
    assert right.yaxis.label.get_size() <= 10 * size[0] / 14


def test_a_whole_figure_or_subfigure_may_be_given():
    mine = Figure()
    assert prediction_figure(prediction_summary(), units(), ax=mine) is mine
    part = Figure(layout="constrained").subfigures(1, 2)[0]
    assert message_figure("nothing", ax=part) is part
    assert part.texts[0].get_text() == "nothing"


def test_wrong_places_and_styles_are_told_by_name():
    with pytest.raises(
        ConfigError, match="style: expected one of nature, ieee, poster"
    ):
        message_figure("a", style="natur")
    with pytest.raises(
        ConfigError, match="ax: expected axes or a figure, found a list"
    ):
        message_figure("a", ax=[])


def test_text_stays_text(tmp_path):
    save_figure(message_figure("one word"), tmp_path / "a", formats=("svg", "pdf"))
    assert ">one word</text>" in (tmp_path / "a.svg").read_text()
    fonts = (tmp_path / "a.pdf").read_bytes()
    assert b"/Type0" in fonts  # a font, whose outlines are in the file once


def test_a_notebook_shows_a_figure_without_pyplot():
    assert "<svg" in message_figure("here")._repr_svg_()


def test_no_letter_is_smaller_than_seven_points():
    for draw in whole_figures():
        sizes = [text.get_fontsize() for text in draw().findobj(Text)]
        assert min(sizes) >= TEXT_PT
