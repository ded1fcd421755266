"""What is not foretold of the contacts may be errors of the instants, or posture."""

from dataclasses import replace

import numpy as np
import pytest
from kinked_landings import landings

from hopdata.maps.verdict import data, judge
from hopdata.maps.verdict.comparison import compared
from hopdata.maps.verdict.data import Options
from hopdata.maps.verdict.effect import AtContact
from hopdata.maps.verdict.limits import ERRORS_UNKNOWN_CODE
from hopdata.maps.verdict.readings import read, under_both
from hopdata.maps.verdict.words import DIFFERENT, without_upper_end
from hopdata.messages import Message

ERROR_S = 0.004


@pytest.fixture(scope="module")
def with_errors():
    """Verdicts on kinks whose instants err, by what is said of their errors."""
    exact = landings(n=500, strength=1.0)
    noise = np.random.default_rng(2).normal(0.0, ERROR_S, exact.instants.shape)
    erring = replace(exact, instants=exact.instants + noise)
    return {
        "exact": _judged(exact),
        "unknown": _judged(erring),
        "right": _judged(erring, np.full(noise.shape, ERROR_S)),
        "none": _judged(erring, np.zeros(noise.shape)),
    }


def _parts(study):
    return study.before, study.after, study.instants


def _judged(study, errors=None):
    return judge(*_parts(study), instants_se=errors, seed=1, flips=99)


def _codes(answer):
    return {note.code for note in answer.notes}


def test_unknown_errors_make_intervals_wide_and_not_wrong(with_errors):
    right = with_errors["right"].effect_over_landings
    none = with_errors["none"].effect_over_landings
    unknown = with_errors["unknown"].effect_over_landings
    true = with_errors["exact"].effect_over_landings.estimate
    # Errors that are said to be none, and so are taken for posture, make it too large.
    assert none.estimate > 1.2 * true
    assert right.estimate == pytest.approx(true, rel=0.1)
    assert unknown.estimate == pytest.approx(true, rel=0.1)
    assert unknown.low == pytest.approx(min(right.low, none.low), rel=0.1)
    assert unknown.high == pytest.approx(max(right.high, none.high), rel=0.1)
    assert unknown.upper_bound >= none.upper_bound


def test_only_unknown_errors_are_noted(with_errors):
    noted = {
        name
        for name, answer in with_errors.items()
        if any(code.startswith(ERRORS_UNKNOWN_CODE) for code in _codes(answer))
    }
    assert noted == {"unknown"}


def test_each_order_holds_under_both(with_errors):
    none = {(one["first"], one["second"]): one for one in with_errors["none"].orders}
    for one in with_errors["unknown"].orders:
        other = none[one["first"], one["second"]]
        assert one["low"] <= other["low"]
        assert one["high"] >= other["high"]


def test_a_fading_that_rests_on_unknown_errors_is_not_stated():
    measured = data.measured(*_parts(landings(n=300, strength=1.0)), None)
    seen = measured.sound_landings().landings
    lasting = read(
        seen, compared(seen), Options(1, 0.2, 0.95, 0.8, 99), errors_known=True
    )
    open_ended = replace(lasting.contact.size, high=np.inf, upper_bound=np.inf)
    fading = replace(lasting, contact=AtContact(open_ended, True, 0.01))
    both = under_both(lasting, fading)
    assert both.contact.size.high == np.inf
    assert both.contact.size.low == lasting.contact.size.low
    assert not both.surely_saturates
    assert under_both(fading, fading).surely_saturates
    said = Message("maps.jump_decides", {"compared": "", "jump": ""})
    stated = without_upper_end(said, DIFFERENT, 0.1, surely=both.surely_saturates)
    assert "is found to fade" not in str(stated)
    assert "is found to fade" in str(without_upper_end(said, DIFFERENT, 0.1))
