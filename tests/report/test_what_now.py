"""What a study's page says to do if the study cannot tell."""

import pytest
from fake_study import full_study, no_answer, verdict

from hopdata.report.what_now import further_advice, limits, limits_of_group

LANDINGS = {
    "cause": "landings",
    "costs": None,
    "said": "Landings: too few.",
    "code": "maps.none_for_landings",
    "values": {"least": 139, "found": 29, "missing": 110},
}
ONE_ORDER = {
    "cause": "orders",
    "costs": None,
    "said": "",
    "code": "maps.none_for_one_order",
    "values": {"order": "left → right", "landings": 42, "least_of_order": 20},
}


def told(of_verdict, **counts):
    """Return all advice of a verdict as one text."""
    found = [str(one.advice) for one in limits(of_verdict)]
    return " ".join(found + [str(one) for one in further_advice(of_verdict, **counts)])


def test_each_limit_has_its_own_advice_and_no_other():
    said = told(no_answer() | {"what_now": [LANDINGS]}, excluded=3, landings=32)
    assert "First get back the landings that were left out" in said
    assert "Left out here: 3 of 32 landings." in said
    assert "`landings.blurred`" not in said, "noise is no limit of this study"
    assert "Left out here" not in told(no_answer() | {"what_now": [LANDINGS]})


def test_more_landings_in_the_same_order_are_not_advised():
    said = told(no_answer() | {"what_now": [ONE_ORDER, LANDINGS]})
    assert "leaves nothing to compare, however long it is recorded" in said
    assert "record more" not in said


@pytest.mark.parametrize(("feet", "needed"), [(2, None), (3, None), (2, 470)])
def test_two_feet_are_told_what_they_cannot_show(feet, needed):
    """Unless the study itself says how many landings it takes."""
    known = no_answer() | {"n_feet": feet, "landings_needed": needed}
    said = told(known | {"what_now": [LANDINGS]})
    assert ("Two feet have one kink only" in said) == (feet == 2 and needed is None)


def test_landings_left_out_are_named_only_if_some_were():
    known = no_answer() | {"what_now": [LANDINGS]}
    for excluded, is_named in ((0, False), (3, True), (None, True)):
        (found,) = limits(known, excluded=excluded)
        assert ("that were left out" in str(found.advice)) == is_named
        assert "ore of the same gait" in str(found.advice)


@pytest.mark.parametrize(
    ("excluded", "is_named"), [((0, 0), False), ((0, 3), True), ((0, None), True)]
)
def test_of_a_group_landings_left_out_are_named_only_if_some_were(excluded, is_named):
    rows = []
    for subject, count in zip("ab", excluded, strict=True):
        row = {"subject": subject, "condition": "", "conclusion": "cannot tell"}
        row |= {"reason": "too few", "what_now": [LANDINGS]}
        # Rows of earlier versions do not have it.
        rows.append(row if count is None else row | {"excluded": count})
    (found,) = limits_of_group(rows)
    assert "2 of 2 studies (a; b)" in str(found.said)
    assert ("that were left out" in str(found.advice)) == is_named
    assert "ore of the same gait" in str(found.advice)


def test_what_stands_already_is_the_bound_if_there_is_one():
    undecided = verdict(conclusion="cannot tell")
    bound = 100 * undecided["effect"]["upper_bound"]
    said = told(undecided).replace("\u00a0", " ")
    assert f"a larger difference than {bound:.2g} % is excluded" in said
    assert "`verdict.margin` is the difference that you care about" in said
    assert "none needs a verdict" not in said
    assert "none needs a verdict" in told(no_answer())


def test_an_answer_needs_no_advice():
    assert told(verdict(conclusion="different")) == ""
    assert limits(full_study().verdict) == []


def test_a_reason_that_is_no_limit_has_advice():
    note = {"code": "maps.copies", "values": {"copies": 40, "landings": 80}}
    (found,) = limits(no_answer() | {"notes": [note], "what_now": []})
    assert "40 of 80 touchdowns are copies" in str(found.said)
    assert "Give one export of each session" in str(found.advice)
