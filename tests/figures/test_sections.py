import numpy as np
import pytest
from fake_tables import densities, frames, sections
from matplotlib.collections import PathCollection
from matplotlib.colors import to_rgba
from overlaps import text_faults

from hopdata.figures.sections import sections_figure
from hopdata.figures.style import FOUND


def panels(figure):
    """Return the axes of each half: scatter, foot density, body density."""
    return [half.axes[:3] for half in figure.subfigs]


def titles(figure):
    return [half.get_suptitle() for half in figure.subfigs]


@pytest.fixture(params=[0.02, 0.211, 0.4], ids=lambda travel: f"{travel * 1000:.0f}mm")
def drawn(request):
    table, limits = frames(request.param, n=2000), sections(request.param)
    return table, limits, sections_figure(table, densities(table, limits), limits)


def test_axes_are_shared_and_labelled_with_units(drawn):
    _, _, figure = drawn
    for (scatter, beside, above), foot in zip(
        panels(figure), ("lowest", "highest"), strict=True
    ):
        assert scatter.get_xlabel() == "mean body height (mm)"
        assert beside.get_ylabel() == f"{foot} foot height (mm)"
        assert beside.get_xlabel() == above.get_ylabel() == "density (1/m)"
        assert scatter.get_ylim() == beside.get_ylim()
        assert scatter.get_xlim() == above.get_xlim()


def test_every_frame_is_drawn_once_and_coloured_by_its_threshold(drawn):
    table, limits, figure = drawn
    up = table["min_foot_m"] > limits["min_foot_threshold_m"]
    down = table["max_foot_m"] < limits["max_foot_threshold_m"]
    for axes, chosen in zip(panels(figure), (up, down), strict=True):
        others, coloured = (
            c for c in axes[0].collections if isinstance(c, PathCollection)
        )
        assert len(coloured.get_offsets()) == chosen.sum()
        assert len(others.get_offsets()) == (~chosen).sum()
        assert tuple(coloured.get_facecolor()[0][:3]) == to_rgba(FOUND)[:3]


def test_dashes_stand_at_thresholds_and_sections(drawn):
    _, limits, figure = drawn
    keys = (
        ("min_foot_threshold_m", "pre_height_m"),
        ("max_foot_threshold_m", "post_height_m"),
    )
    both = sorted(1000 * limits[section] for _, section in keys)
    for (scatter, beside, above), (key, section) in zip(
        panels(figure), keys, strict=True
    ):
        flat = [
            line.get_ydata()[0]
            for line in scatter.lines
            if np.ptp(line.get_ydata()) == 0
        ]
        assert flat == pytest.approx([1000 * limits[key]])
        assert beside.lines[-1].get_ydata()[0] == flat[0]
        assert above.lines[-1].get_xdata()[0] == pytest.approx(1000 * limits[section])
        between = above.patches[-1].get_bbox()
        assert [between.x0, between.x1] == pytest.approx(both)


def test_the_other_rule_is_dotted_and_named(drawn):
    _, limits, figure = drawn
    for half, side in zip(figure.subfigs, ("pre", "post"), strict=True):
        wanted = [
            1000 * limits[f"{side}_height_m"],
            1000 * limits["other_rule"][f"{side}_height_m"],
        ]
        for axes in (half.axes[0], half.axes[2], half.axes[3]):
            upright = [
                line.get_xdata()[0]
                for line in axes.lines
                if np.ptp(line.get_xdata()) == 0
            ]
            assert sorted(upright) == pytest.approx(sorted(wanted))
    named = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "section by the printed rule" in named
    alone = sections_figure(
        drawn[0], densities(drawn[0], limits), limits | {"other_rule": {}}
    )
    assert not any(
        "by the rule" in text.get_text() for text in alone.legends[0].get_texts()
    )


def test_titles_count_landings_and_claim_nothing_about_frames(drawn):
    table, limits, figure = drawn
    pre, post = titles(figure)
    assert pre.endswith("holds 100 % of landings")
    assert post.endswith("holds 98 % of landings"), "98.9 % are not 99"
    assert "down" not in pre + post
    curves = densities(table, limits)
    few = limits | {"landing_shares": {"pre": 0.4, "post": None}}
    few["chosen_by"] = {"pre_height_m": "config", "post_height_m": "data"}
    pre, post = titles(sections_figure(table, curves, few))
    assert pre.endswith("mm (given), holds 40 % of landings")
    assert post.endswith(" mm")


def test_the_top_row_shows_heights_in_landings(drawn):
    table, limits, figure = drawn
    for half, curves in zip(
        figure.subfigs,
        (("top", "first_contact"), ("lowest", "last_contact")),
        strict=True,
    ):
        peaks = [
            line.get_xdata()[np.argmax(line.get_ydata())]
            for line in half.axes[3].lines
            if np.ptp(line.get_xdata()) > 0
        ]
        known = densities(table, limits).set_index("curve")
        wanted = [
            1e3
            * known.loc[name, "height_m"].to_numpy()[
                known.loc[name, "density_per_m"].argmax()
            ]
            for name in curves
        ]
        assert peaks == pytest.approx(wanted)


def test_no_text_lies_over_another(drawn):
    assert text_faults(drawn[2]) == []


def test_without_sections_the_data_are_still_drawn():
    table = frames(n=200)
    limits = {"pre_height_m": None, "min_foot_threshold_m": float("nan")}
    empty = densities(table, sections()).iloc[:0]
    figure = sections_figure(table, empty, limits)
    for scatter, _, above in panels(figure):
        assert sum(len(c.get_offsets()) for c in scatter.collections) == 200
        assert any("no frame" in text.get_text() for text in above.texts)
    assert text_faults(figure) == []


def test_a_section_from_the_config_beyond_the_data_is_within_the_axes():
    table, limits = frames(n=300), sections() | {"pre_height_m": 0.9}
    figure = sections_figure(table, densities(table, sections()), limits)
    assert panels(figure)[0][0].get_xlim()[1] > 900
    assert text_faults(figure) == []


def test_one_frame_is_enough_and_none_is_said():
    limits = sections()
    one, empty = frames(n=1), densities(frames(n=50), limits).iloc[:0]
    assert text_faults(sections_figure(one, empty, limits)) == []
    none = sections_figure(one.iloc[:0], empty, limits)
    assert "No frame" in none.texts[0].get_text()


def test_without_landings_each_half_has_the_three_axes_of_the_printed_figure():
    table = frames(0.211, n=2000)
    limits = sections(0.211)
    figure = sections_figure(table, densities(table, limits), limits, landings=False)
    assert [len(half.axes) for half in figure.subfigs] == [3, 3]
    (legend,) = figure.legends
    told = [text.get_text() for text in legend.get_texts()]
    assert not any("landings: at" in text for text in told)


def test_no_section_crosses_the_name_of_a_branch(drawn):
    _, _, figure = drawn
    figure.draw_without_rendering()
    names = 0
    for scatter, _, _ in panels(figure):
        lines = [line for line in scatter.lines if np.ptp(line.get_xdata()) == 0]
        across = [
            scatter.transData.transform((line.get_xdata()[0], 0))[0] for line in lines
        ]
        for text in scatter.texts:
            if text.get_text() not in ("descent", "ascent"):
                continue
            names += 1
            box = text.get_window_extent()
            assert not any(box.x0 < place < box.x1 for place in across)
    assert names > 0
