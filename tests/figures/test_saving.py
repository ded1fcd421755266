import hashlib
import os

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
from PIL import Image, ImageChops

from hopdata.errors import ConfigError
from hopdata.figures.distances import distances_figure
from hopdata.figures.prediction import prediction_figure
from hopdata.figures.saving import save_figure
from hopdata.figures.schedule import schedule_figure
from hopdata.figures.sections import sections_figure
from hopdata.figures.style import message_figure, paper_figure, style_context


def draw(name):
    if name == "sections":
        table, limits = frames(n=500), sections()
        return sections_figure(table, densities(table, limits), limits)
    if name == "schedule":
        row = touchdown()
        return schedule_figure(example(row), row)
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
    one = save_figure(prediction_figure(prediction_summary(), units()), tmp_path / "one")
    two = save_figure(prediction_figure(prediction_summary(("all",)), units()), tmp_path / "two")
    assert one[0].read_bytes() != two[0].read_bytes()


def test_nothing_stays_of_a_process_that_was_killed_while_it_saved(tmp_path, monkeypatch):
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
    files = save_figure(draw("prediction"), tmp_path / "fig.v2", formats=("png", "svg"), dpi=100)
    assert [path.name for path in files] == ["fig.v2.png", "fig.v2.svg"]
    assert sorted(tmp_path.iterdir()) == sorted(files)
    with Image.open(files[0]) as image:
        assert image.width == pytest.approx(175 / 25.4 * 100, abs=1)
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
        assert ImageChops.difference(one.convert("RGB"), other.convert("RGB")).getbbox() is None


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
