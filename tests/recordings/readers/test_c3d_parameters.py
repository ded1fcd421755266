"""Parameters of a C3D file that count something."""

from pathlib import Path

import numpy as np
import pytest

from hopdata.errors import RecordingError
from hopdata.recordings.readers.c3d_parameters import PROCESSORS, Parameters

PROCESSOR = next(iter(PROCESSORS.values()))


def stating(number):
    groups = {"ANALOG": {"USED": np.array([number])}}
    return Parameters(Path("walk.c3d"), PROCESSOR, groups)


@pytest.mark.parametrize("number", [0.0, 1.0, 64.0])
def test_a_whole_number_counts(number):
    assert stating(number).count("ANALOG", "USED") == number


def test_what_is_not_stated_counts_nothing():
    assert stating(3.0).count("EVENT", "USED") == 0


@pytest.mark.parametrize("number", [-1.0, 2.5, np.nan, np.inf, 1e300])
def test_what_counts_nothing_is_told_with_its_place(number):
    with pytest.raises(RecordingError, match=r"walk\.c3d: ANALOG:USED.*a count"):
        stating(number).count("ANALOG", "USED")
