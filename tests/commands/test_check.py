"""``hopdata check`` says what was guessed."""

import numpy as np
import pytest
from made_up_files import export
from made_up_hopper import MARKERS, hopping
from trc_files import trc_text

from hopdata.cli import main

STUDY = """study: trial
input: {{unit: {unit}}}
recordings:
  - {{name: one, file: {file}}}
markers: {{body: [hip1, hip2, hip3], feet: [toe1, toe2, toe3]}}
"""


@pytest.fixture
def check(tmp_path, capsys):
    """The notes of a check that finds the study sound."""

    def checked(file, unit="auto"):
        config = tmp_path / "study.yaml"
        config.write_text(STUDY.format(file=file, unit=unit))
        assert main(["check", str(config)]) == 0
        return [x for x in capsys.readouterr().out.splitlines() if x.startswith("note:")]

    return checked


def test_a_unit_that_was_guessed_is_noted_with_the_key_that_settles_it(check, tmp_path):
    file = tmp_path / "silent.trc"
    file.write_text(trc_text(1000 * hopping(1)[1], MARKERS, values={"Units": None}))
    (note,) = check(file)
    assert note == (
        f"note: {file}: unit: expected the file to state it, found none; taken for mm, in which "
        "the markers span 0.936 m and fall at 9.81 m/s² in 37 % of the frames; input.unit: mm "
        "makes it certain"
    )
    assert check(file, unit="mm") == []


def test_a_unit_that_the_format_prescribes_is_not_noted(check, tmp_path):
    assert check(export(tmp_path)) == []


def test_whole_millimetres_are_noted(check, tmp_path):
    (note,) = check(export(tmp_path, np.round(hopping(1)[1], 3)))
    assert "coordinates are rounded to 1 mm, which adds noise of 0.29 mm" in note
