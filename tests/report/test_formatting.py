import math

import pytest

from hopdata.report.formatting import (
    PROSE,
    Table,
    common_scale,
    count,
    fixed,
    labelled,
    p_value,
    percent,
    plain,
    significant,
    told_p_value,
    with_unit,
    words,
)
from hopdata.report.inputs import TEMPLATES


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (29.13, "29.1"),
        (27.0, "27"),
        (-0.0123, "−0.0123"),
        (182611.4, "182\u202f611"),
        (1.95e-5, "1.95 × 10⁻⁵"),
        (0.00195, "0.00195"),
        (0, "0"),
        (None, "—"),
        (math.nan, "—"),
        (math.inf, "—"),
    ],
)
def test_three_significant_digits(value, text):
    assert significant(value) == text


def test_fixed_decimals_and_counts():
    assert fixed(-12345.67, 1) == "−12\u202f345.7"
    assert fixed(1029.44, 1) == "1029.4"  # four digits are not separated
    assert fixed(None, 2) == count(math.nan) == "—"
    assert count(182611) == "182\u202f611"


def test_numbers_keep_their_units():
    assert with_unit("27", "ms") == "27\u00a0ms"
    assert with_unit("—", "ms") == "—"
    assert percent(97.5) == "97.5\u00a0%"


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("residual_rms_m", 0.00058, ("residual rms", "0.58", "mm")),
        ("speed_m_s", 1.25, ("speed", "1.25", "m/s")),
        ("error_mm_s", 1.25, ("error", "1.25", "mm/s")),
        ("rate_hz", 100, ("rate", "100", "Hz")),
        ("pre_height_m", None, ("pre height m", "—", "")),
        ("misfit", [0.014825832, 0.5], ("misfit", "0.0148, 0.5", "")),
        ("depth edges_m", [0.014825832, 0.02], ("depth edges", "14.8, 20", "mm")),
        ("enabled", True, ("enabled", "yes", "")),
        ("frames", "all", ("frames", "all", "")),
        ("n_frames", 64345, ("n frames", "64\u202f345", "")),
        ("mode n_used", 64345, ("mode n used", "64\u202f345", "")),
    ],
)
def test_keys_in_si_become_words_and_shown_units(key, value, expected):
    assert labelled(key, value) == expected


def test_plain_values_of_any_kind():
    values = (True, 20261121, 0.12345, None, "x", [1, 2], {"a": 1})
    shown = ["yes", "20261121", "0.1235", "—", "x", "[1, 2]", '{"a": 1}']
    assert [plain(value) for value in values] == shown


def test_scale_brings_the_smallest_value_to_one_or_more():
    assert common_scale([0.00195, 0.03, None]) == (1e-3, "10⁻³ ")
    assert common_scale([2e-7]) == (pytest.approx(1e-9), "10⁻⁹ ")
    assert common_scale([3.0, 0.0]) == common_scale([]) == (1.0, "")


def test_words_are_joined_as_in_a_sentence():
    assert [words(w) for w in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == [
        "",
        "a",
        "a and b",
        "a, b and c",
    ]


def test_a_column_of_long_texts_is_prose():
    rows = (("a", "b" * (PROSE + 1), "1", "mm"), ("c", "d", "2", "s"))
    table = Table("t", ("name", "remark", "value", "unit"), rows, text_columns=2)
    assert [table.kind(i) for i in range(4)] == ["text", "prose", "number", "unit"]


def test_the_style_knows_every_kind_that_it_must_treat_apart():
    style = (TEMPLATES / "report.css").read_text()
    assert (
        ".picture img { background: #fff;" in style
    )  # figures stay white in dark mode
    for kind in (".prose", ".number", ".unit"):
        assert kind in style


def test_a_p_value_is_never_told_as_one():
    """No number of random signs shows that a p-value is exactly 1."""
    assert p_value(1.0) == p_value(0.996) == ">0.99"
    assert p_value(0.99) == "0.99"
    assert p_value(0.0005) == "0.0005"
    assert p_value(None) == "—"
    assert told_p_value(1.0) == "p >0.99"
    assert told_p_value(0.031) == "p = 0.031"
