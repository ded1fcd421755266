"""Reasons of the table of touchdowns, from their words back to their codes."""

import pytest

from hopdata.landings.exclusion import OF_A_FOOT, OF_ALL_FEET, reason_of
from hopdata.messages import Message

FEET = ("LF", "RF")


@pytest.mark.parametrize("code", OF_ALL_FEET)
def test_a_reason_of_all_feet_is_known_by_its_words(code):
    assert reason_of(Message(code).text(), FEET) == Message(code)


@pytest.mark.parametrize("code", OF_A_FOOT)
def test_a_reason_of_a_foot_is_known_with_the_foot(code):
    for number in (1, 2):
        reason = Message(code, {"foot": number})
        assert reason_of(reason.text(), FEET) == reason
        named = reason.text().replace(f"foot {number}", FEET[number - 1])
        assert reason_of(named, FEET) == reason
    assert reason_of(Message(code, {"foot": 3}).text(), FEET) is None


def test_a_reason_by_hand_is_not_taken_for_another():
    values = {"reason": Message(OF_ALL_FEET[0]).text()}
    assert reason_of(Message("landings.by_hand", values).text(), FEET) is None
    assert reason_of("", FEET) is None
