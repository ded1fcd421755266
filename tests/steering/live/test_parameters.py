import pytest

from hopdata.steering.live.errors import GarbageError, LabelError, SettingsError
from hopdata.steering.live.parameters import (
    StreamParameters,
    check_settings,
    find_labels,
    parameters_xml,
    read_parameters,
)


def test_labels_and_rate_come_back():
    document = parameters_xml(["body <1>", "boom"], 99.5, parts=["general", "3d"])
    parameters = read_parameters(document)
    assert parameters.labels == ("body <1>", "boom")
    assert parameters.rate_hz == 99.5


def test_only_the_parts_asked_for_are_sent():
    assert read_parameters(parameters_xml(["a"], 100, parts=["general"])).labels == ()
    assert read_parameters(parameters_xml(["a"], 100, parts=["3d"])).rate_hz is None


def test_what_is_not_xml_is_an_error():
    with pytest.raises(GarbageError, match="expected XML"):
        read_parameters(b"<QTM")


def test_our_own_settings_are_sound():
    parameters = read_parameters(parameters_xml(["a"], 100, parts=["all"]))
    assert parameters.upwards == "+Z"
    check_settings(parameters, 100.0)
    check_settings(parameters, None)
    check_settings(StreamParameters(("a",), None), 100.0)  # says nothing


def test_another_axis_or_rate_is_an_error():
    with pytest.raises(SettingsError, match=r"points up in the stream: expected \+Z, found \+Y"):
        check_settings(StreamParameters(("a",), 100.0, "+Y"), 100.0)
    with pytest.raises(SettingsError, match="expected 100 Hz, found 300 Hz"):
        check_settings(StreamParameters(("a",), 300.0, "+Z"), 100.0)


def test_markers_are_found_by_label():
    assert find_labels(["c", "a"], ["a", "b", "c"]) == [2, 0]


def test_a_missing_label_is_named_with_the_nearest():
    with pytest.raises(LabelError, match=r"marker 'bodi1' .*\(body1, boom\); did you mean 'body1'"):
        find_labels(["boom", "bodi1"], ["body1", "boom"])


def test_a_label_that_stands_twice_is_refused():
    with pytest.raises(LabelError, match="more than once"):
        find_labels(["a"], ["a", "a"])
