"""The part `labels` on a short recording, whose truth is known."""

from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from hopdata.config.loading import load_config
from hopdata.dissertation.items import read_part
from hopdata.dissertation.labelling import recorded, sample_by_both, touchdowns
from hopdata.dissertation.parts import labels
from hopdata.dissertation.report.sentences import filled
from hopdata.dissertation.rows import Agreement
from hopdata.dissertation.sample import study_of
from hopdata.recordings.stored import write_with_truth
from hopdata.synthesis import simulate_recording

ITEMS = [11, *range(15, 32)]


def configuration(study, **keys):
    return {
        "study": study,
        "recordings": [{"name": "short", "file": "short.h5"}],
        "markers": {
            "body": ["body1", "body2", "body3"],
            "feet": ["foot1", "foot2", "foot3"],
        },
        "home": {"marker": "body1"},
        **keys,
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("labels")
    write_with_truth(
        folder / "short.h5", simulate_recording({"hops": 150}, seed=3, name="short")
    )
    files = {
        (sample_by_both, "SAMPLE_FILE"): configuration("short"),
        (recorded, "THESIS_FILE"): configuration(
            "thesis",
            recordings=[{"name": "one", "simulation": {"duration_s": 40.0}}],
        ),
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for (module, name), content in files.items():
            file = folder / f"{content['study']}.yaml"
            file.write_text(yaml.safe_dump(content))
            patch.setattr(module, name, str(file))
        found = labels.make([1, 2])
    by_item = {row.item: row for row in found.rows}
    return SimpleNamespace(rows=by_item, tables=found.tables)


def test_each_item_has_its_row_and_every_sentence_its_numbers(made):
    assert [one.number for one in read_part("labels")] == ITEMS == [*made.rows]
    for item in read_part("labels"):
        row = made.rows[item.number].to_dict()
        said = [item.printed, item.printed_method, item.ours]
        if row["reason"]:
            said.append(item.reasons[row["reason"]])
        for sentence in said:
            assert "{" not in filled(sentence, row["values"])


def test_the_robot_is_as_the_text_describes_it(made):
    found = {item: made.rows[item].agreement for item in (11, 15, 16, 17)}
    claims = {11: Agreement.PARTLY, 16: Agreement.AGREES}
    assert found == claims | dict.fromkeys((15, 17), Agreement.BUILT)
    assert made.rows[11].values["pushed_yaw"] < 1e-6
    assert made.rows[11].values["yaw"] < -1
    assert made.rows[15].values["jump"] == pytest.approx(22.0)
    assert made.rows[16].values["damped"] < 40 < made.rows[16].values["share"]


def test_a_recording_of_another_size_differs(made):
    row = made.rows[18]
    assert row.values["frames"] == 4000
    assert row.agreement is Agreement.DIFFERS
    assert len(row.values["hop"]) == 2
    assert row.values["hop"] == pytest.approx([0.64, 0.64], abs=0.03)


def test_the_two_readings_of_the_noise_differ_by_the_root_of_two(made):
    values = made.rows[19].values
    ratio = np.array(values["harder"]) / np.array(values["easier"])
    np.testing.assert_allclose(ratio, np.sqrt(2), rtol=0.05)
    assert values["coordinate"] == pytest.approx(0.6, rel=0.1)


def test_the_printed_sections_follow_the_bandwidth(made):
    thresholds = made.rows[23].values
    assert thresholds["low_to"] > 10 * thresholds["low_from"]
    heights = made.rows[24].values
    assert heights["post_to"] - heights["post_from"] > 5
    assert heights["pre_to"] - heights["pre_from"] > 5
    assert heights["printed_inside"] < heights["ours_inside"]


def test_the_printed_labels_are_worse_and_their_plus_stands_on_the_minimum(made):
    assert made.rows[27].values["right"] > made.rows[27].values["printed_right"] + 5
    assert (
        made.rows[28].values["ours_outside"] < made.rows[28].values["printed_outside"]
    )
    assert made.rows[29].values["printed"] < 1e-9 < 0.1 < made.rows[29].values["ours"]


def test_states_do_not_depend_on_place_and_heading(made):
    assert max(made.rows[30].values["change"]) < 1e-9


def test_the_units_of_the_text_agree_with_each_other_not_with_the_scene(made):
    values = made.rows[31].values
    assert values["text_position"] == pytest.approx(values["text_velocity"], rel=0.1)
    assert values["text_speed"] == pytest.approx(1.079, abs=1e-3)
    assert made.rows[31].agreement is Agreement.PARTLY


def test_both_figures_show_both_methods(made):
    figures = labels.draw(made.tables)
    assert set(figures) == {one.figure for one in read_part("labels") if one.figure}
    axes = {name: len(figure.get_axes()) for name, figure in figures.items()}
    assert axes == {"fig2_2_both": 12, "fig2_3_both": 6}
    for figure in figures.values():
        headings = [half.get_suptitle() for half in figure.subfigs]
        assert headings == ["As printed", "hopdata's method"]


def test_the_study_printed_is_the_sample_by_the_printed_methods():
    sample = study_of(printed=True).config
    printed = load_config("config/printed.yaml")
    assert printed == {**sample, "study": "printed"}


@pytest.mark.parametrize(
    ("percent", "other", "higher"),
    [(80.0, 70.0, True), (75.4, 74.7, False), (70.0, 80.0, False)],
)
def test_a_share_is_higher_by_two_standard_errors(percent, other, higher):
    assert touchdowns.is_higher(percent, other, 1635) is higher
