"""Rotations of segments in C3D: their origins become markers."""

import numpy as np
import pytest
from qtm_files import NAMES, standing
from vendor_files import theia

from hopdata.errors import RecordingError
from hopdata.recordings.readers.formats import read_raw


def places():
    positions = standing(20)
    positions[3:5, 1] = np.nan
    return positions


def written(tmp_path, data):
    path = tmp_path / "trial.c3d"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("processor", ["Intel", "DEC", "MIPS"])
@pytest.mark.parametrize("ratio", [1, 3])
def test_origins_are_read_where_there_are_no_points(tmp_path, processor, ratio):
    data = theia(places(), NAMES, processor=processor, ratio=ratio, rate=85.0)
    found = read_raw(written(tmp_path, data))
    np.testing.assert_allclose(found.positions, places(), rtol=1e-6)
    assert (found.markers, found.rate_hz, found.unit) == (NAMES, 85.0, "mm")
    codes = [remark.code for remark in found.remarks]
    assert codes[:2] == ["recordings.segment_origins", "recordings.segments_at_origin"]
    assert ("recordings.segments_at_other_rate" in codes) == (ratio > 1)


def test_origins_stand_behind_points(tmp_path):
    points = (("toe", "LASI"), standing(20)[:, :2])
    found = read_raw(written(tmp_path, theia(places(), NAMES, points=points)))
    others = tuple(f"{n} origin" if n == "toe" else n for n in NAMES)
    assert found.markers == ("toe", "LASI", *others)
    np.testing.assert_allclose(found.positions[:, :2], points[1], rtol=1e-6)
    np.testing.assert_allclose(found.positions[:, 2:], places(), rtol=1e-6)


def test_rotations_that_are_not_there_are_told(tmp_path):
    whole = theia(places(), NAMES)
    path = written(tmp_path, whole[:-2000])
    with pytest.raises(RecordingError, match="found room for"):
        read_raw(path)
    still = theia(np.zeros((20, 5, 3)), NAMES)
    with pytest.raises(RecordingError, match="segments that never leave the origin"):
        read_raw(written(tmp_path, still))
