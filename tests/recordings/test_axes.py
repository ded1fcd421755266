import numpy as np
import pytest

from hopdata.recordings.axes import FILE_AXES, along_file, opposite, rotate_up


@pytest.mark.parametrize("axis", FILE_AXES)
def test_turning_is_a_proper_rotation(axis):
    turned = rotate_up(np.eye(3), axis).T
    assert np.linalg.det(turned) == pytest.approx(1.0)
    sign = -1 if axis.startswith("-") else 1
    assert (turned @ (sign * np.eye(3)["xyz".index(axis[-1])]) == [0, 0, 1]).all()


@pytest.mark.parametrize("axis", FILE_AXES)
def test_an_offset_goes_back_to_the_axes_of_the_file(axis):
    in_file = np.array([1.0, 2.0, 3.0])
    assert along_file(rotate_up(in_file, axis), axis) == {"x": 1.0, "y": 2.0, "z": 3.0}


@pytest.mark.parametrize("axis", FILE_AXES)
def test_the_opposite_of_up_is_down(axis):
    assert opposite(axis) in FILE_AXES
    assert opposite(axis) != axis
    assert opposite(opposite(axis)) == axis
