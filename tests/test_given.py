import numpy as np
import pytest

from hopdata.errors import ArgumentError, RecordingError
from hopdata.given import feet_and_joined, marker_names, numbers


def test_numbers_may_be_masked_and_must_be_numbers():
    masked = np.ma.masked_array([1, 2], mask=[False, True])
    np.testing.assert_array_equal(numbers("x", masked), [1.0, np.nan])
    with pytest.raises(ArgumentError, match="x: expected an array of numbers"):
        numbers("x", ["a"])


def test_names_are_a_list_of_different_texts():
    assert marker_names("feet", iter(["a", "b"])) == ("a", "b")
    for wrong in ("ab", [1], 3):
        with pytest.raises(RecordingError, match="feet: expected a list of marker"):
            marker_names("feet", wrong)
    with pytest.raises(RecordingError, match="each name once"):
        marker_names("feet", ["a", "a"])


def test_a_foot_with_its_own_marker_alone_is_not_joined():
    assert feet_and_joined(["a", "b"]) == (("a", "b"), ())
    markers, joined = feet_and_joined({"a": ["a"], "left": ["heel", "toe"]})
    assert markers == ("a", "heel", "toe")
    assert joined == (("left", ("heel", "toe")),)
    with pytest.raises(RecordingError, match=r"feet\.left: expected a marker"):
        feet_and_joined({"left": []})
