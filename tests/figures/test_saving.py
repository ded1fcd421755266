import hashlib

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
from PIL import Image

from hopdata.errors import ConfigError
from hopdata.figures.distances import distances_figure
from hopdata.figures.prediction import prediction_figure
from hopdata.figures.saving import save_figure
from hopdata.figures.schedule import schedule_figure
from hopdata.figures.sections import sections_figure


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
