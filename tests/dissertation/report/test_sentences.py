import pytest

from hopdata.dissertation.report.sentences import filled
from hopdata.report.formatting import NO_BREAK_SPACE


@pytest.mark.parametrize(
    ("template", "values", "text"),
    [
        ("slope {x:.2f}", {"x": 4.196}, "slope 4.20"),
        ("{x:.1f} mm", {"x": -0.25}, "−0.2 mm"),
        ("{x} mm", {"x": 1.30812}, "1.31 mm"),
        ("{n} maps", {"n": 36}, "36 maps"),
        ("{n:,} schedules", {"n": 46656}, "46,656 schedules"),
        ("{x:.0e}", {"x": 3.2e-16}, "3\u00a0×\u00a010⁻¹⁶"),
        ("{x:.0e}", {"x": 1e-9}, "10⁻⁹"),
        ("{x:.1e}", {"x": 1.5}, "1.5"),
        ("{x:.0%}", {"x": 0.756}, f"76{NO_BREAK_SPACE}%"),
        ("{x:.1g}", {"x": 30.4}, "30"),
        ("{x:.2g}", {"x": -1234.5}, "−1200"),
        ("{x:.2g}", {"x": 3.16e-7}, "3.2\u00a0×\u00a010⁻⁷"),
        ("{kind}", {"kind": "arc length"}, "arc length"),
        ("{holds}", {"holds": True}, "yes"),
        ("{holds}", {"holds": False}, "no"),
    ],
)
def test_a_single_value(template, values, text):
    assert filled(template, values) == text


@pytest.mark.parametrize(
    ("form", "values", "text"),
    [
        ("{x:.1f}", [3.0, 1.0, 2.04], "2.0 (1.0 to 3.0)"),
        ("{x:.1f}", [1.0, 2.0], "1.5 (1.0 to 2.0)"),
        ("{x:.0f}", [4.1, 4.2, 3.9], "4"),
        ("{x:d}", [1, 2, 4, 5], "3 (1 to 5)"),
        ("{x:.2f}", [7.0], "7.00"),
        ("{x:.1f}", [-2.0, -1.0, -3.0], "−2.0 (−3.0 to −1.0)"),
        ("{x}", ["euler", "rk4", "euler"], "euler, rk4"),
    ],
)
def test_a_sequence_is_its_median_and_range(form, values, text):
    assert filled(form, {"x": values}) == text


def test_a_minus_that_is_no_sign_stays():
    assert filled("{orders}", {"orders": "R-L"}) == "R-L"


def test_a_value_that_is_not_there_is_an_error():
    with pytest.raises(KeyError, match="slope"):
        filled("{slope:.1f}", {"slopes": 1.0})
    with pytest.raises(ValueError):
        filled("{name:.1f}", {"name": "four"})
