import numpy as np
import pandas as pd
import pytest
from fake_study import full_study, no_answer, touchdowns, verdict
from test_page import Page

from hopdata.maps.verdict import limits
from hopdata.maps.verdict.growth import Growth
from hopdata.maps.verdict.inputs import contact_spread
from hopdata.maps.verdict.saturation import LEVEL
from hopdata.messages import Message
from hopdata.report.page import build_report
from hopdata.report.tables import truth_table
from hopdata.report.verdict import (
    SATURATES_BELOW,
    answer,
    contacts_told,
    meaning,
    one_or_own_table,
    orders_table,
    reach,
    verdict_facts,
    worded,
)


def test_the_card_says_effect_interval_and_the_bound_that_decides():
    facts = verdict_facts(verdict())
    assert facts["difference"] == "4 (0 to 14)\u00a0%"
    bound = "print the one-sided bound 12\u00a0%, on which the answer rests; less than 20\u00a0% counts as none"
    assert facts["remark"] == f"of the map, 95\u00a0% interval; {bound}"
    assert facts["found"] is True


def test_where_a_difference_was_found_nothing_is_said_to_be_excluded():
    remark = verdict_facts(verdict(conclusion="different"))["remark"]
    assert remark == "of the map, 95\u00a0% interval"


def test_the_true_difference_of_a_simulation_stands_beside_the_estimate():
    truth = {"verdict_true_effect": {"value": 0.0512, "unit": "1", "what": ""}}
    facts = verdict_facts(verdict(), truth)
    assert facts["true"] == "5.1\u00a0%"
    at = "at the simultaneous contact nearest to the mean landing"
    assert facts["remark"].endswith(f"; {at}, true in this simulation: 5.1\u00a0%")
    page = Page(build_report(full_study(truth=truth)))
    assert "true in this simulation: 5.1 %" in page.text
    assert (
        verdict_facts(verdict(), {"verdict_true_effect": {"value": None}})["true"]
        is None
    )


def test_without_an_answer_or_a_verdict_the_same_keys_are_there():
    assert verdict_facts(no_answer()).keys() == verdict_facts(verdict()).keys()
    assert verdict_facts(None).keys() == verdict_facts(verdict()).keys()
    assert verdict_facts(no_answer())["remark"] == "cannot tell"
    assert verdict_facts(None)["sentence"] is None


def test_the_verdict_opens_the_page():
    page = Page(build_report(full_study()))
    sentence = "No difference larger than 0.12 of the map"
    assert page.text.index(sentence) < page.text.index(
        "Is landing on several feet one smooth map"
    )
    assert page.text.index("Difference of the maps 4") < page.text.index("Recordings 1")
    assert page.ids.index("verdict") == page.ids.index("glance") + 1
    assert "you would need about 600 landings" in page.text
    assert str(meaning(None)) in page.text


def test_a_study_without_an_answer_has_a_page_that_says_why():
    page = Page(build_report(full_study(verdict=no_answer())))
    assert page.unbalanced == page.open == []
    for words in (
        "These data cannot tell: 120 landings are too few",
        "verdict: 120 landings are too few for second-order terms",
        "Difference of the maps not known cannot tell",
    ):
        assert words in page.text


def test_without_a_size_there_is_no_empty_figure_of_orders():
    without = full_study(verdict=no_answer())
    drawn = [one for one in without.figures if one.name != "verdict_orders"]
    none = build_report(full_study(verdict=no_answer(), figures=drawn))
    assert len(drawn) < len(without.figures)
    assert build_report(without) == none


def test_the_answer_is_not_told_again_by_its_picture():
    """Without a number, the picture would repeat the sentence."""
    told = no_answer()
    page = Page(build_report(full_study(verdict=told)))
    assert page.text.count(told["sentence"]) == 1
    page = Page(build_report(full_study()))
    assert page.text.count(verdict()["sentence"]) == 1


def test_what_foretells_the_contacts_stands_under_the_verdict_and_its_picture():
    said = "The state and the feet foretell 99.9 % of how far apart the feet touch."
    page = Page(build_report(full_study(verdict=verdict(contacts=said))))
    assert page.text.count(said) == 2
    assert "foretell" not in Page(build_report(full_study())).text


def test_what_holds_at_the_contact_is_told_beside_what_holds_over_the_landings():
    reach = {"holds_from": 0.00652, "contact_spread": 0.0119}
    page = Page(build_report(full_study(verdict=verdict(**reach))))
    text = page.text.replace("\u00a0", " ")
    spread = "contacts spread by 12 ms (standard deviation of the instants of a landing"
    assert f"spent once contacts are some 6.5 ms apart. Here {spread}, rms)." in text
    assert "6.5 ms apart could be more than 20 % where all feet touch at once" in text
    assert "it is spent" not in page.text.lower()
    assert "6.5" not in Page(build_report(full_study())).text

    over = verdict()["effect"] | {"estimate": 0.21, "low": 0.12, "high": 0.31}
    found = {"conclusion": "different", "saturates": True, "effect_over_landings": over}
    found["effect"] = over | {"high": None, "upper_bound": None}
    page = Page(build_report(full_study(verdict=verdict(**reach | found))))
    assert "over the landings of this study it is 21 (12 to 31) %." in page.text
    assert "The bar is of the simultaneous contact." in page.text
    assert "at least 12 %" in page.text.replace("\u00a0", " ")
    assert "no upper end can be given" in page.text
    assert "6.5 ms" not in page.text

    jump = {"decided_by": "jump", "jump": verdict()["effect"]}
    facts = verdict_facts(verdict(**reach | found | jump))
    assert facts["over_landings"] is None
    assert facts["holds_from"] is None


def test_a_true_difference_that_the_file_states_stands_beside_the_answer():
    stated = {"value": 3.2e-16, "unit": "1", "what": "True difference"}
    truth = {"recorded_true_effect": stated}
    inputs = full_study(truth=truth)
    text = Page(build_report(inputs)).text.replace("\u00a0", " ")
    assert "true in this simulation: 0 %" in text
    assert "The triangle is" not in text, "none is drawn"
    (row,) = truth_table(truth).rows
    assert row == ("True difference", "0", "%")


def test_two_feet_touch_twice_their_spread_apart():
    """A standard deviation of two instants is half of their difference."""
    instants = np.array([[0.0, 0.0138], [0.0138, 0.0]])
    spread_s = contact_spread(instants)
    found = {"conclusion": "different", "contact_spread": spread_s}
    said = " ".join(map(str, answer(verdict(**found | {"n_feet": 2}))))
    said = said.replace("\u00a0", " ")
    assert "spread by 6.9 ms (standard deviation" in said
    assert "the two feet touch 14 ms apart" in said
    of_three = " ".join(map(str, answer(verdict(**found | {"n_feet": 3}))))
    assert "apart" not in of_three


def test_notes_stand_under_the_verdict():
    noted = verdict(notes=[{"what": "smooth terms", "reason": "150 landings"}])
    page = Page(build_report(full_study(verdict=noted)))
    assert "What limits this verdict: smooth terms: 150 landings" in page.text
    assert "What limits" not in Page(build_report(full_study())).text


def test_which_orders_differ_is_said_and_tabled():
    pair = {"of": "map", "first": "1>2", "second": "2>1", "estimate": 0.4}
    pair |= {"low": 0.2, "high": 0.5, "p_value": 0.0005}
    pair |= {"n_first": 31, "n_second": 47, "allowed": 0.1}
    known = verdict(
        n_feet=2,
        orders=[pair],
        main_contrast="surest to differ are the orders 1 → 2 and 2 → 1",
    )
    page = Page(build_report(full_study(verdict=known)))
    said = "Which orders differ: surest to differ are the orders 1 → 2 and 2 → 1."
    assert said in page.text
    row = "two maps 1 → 2 and 2 → 1 31, 47 40.0 20.0 50.0 0.0005"
    assert row in page.text
    for assumed in ("max T over 1999 random sign", "up to 10 % in one of these rows"):
        assert assumed in page.text.replace("\u00a0", " ")
    assert "Which orders differ:" not in Page(build_report(full_study())).text
    named = touchdowns().assign(contact_toe_s=0.0, contact_heel_s=0.0)
    page = Page(build_report(full_study(verdict=known, touchdowns=named)))
    assert "toe → heel and heel → toe" in page.text


@pytest.mark.parametrize("code", ["maps.no_difference", "maps.of_an_older_version"])
def test_a_verdict_of_an_earlier_version_is_shown_in_its_own_words(code):
    """Its messages lack a value of today's template, or have a code without one."""
    values = {"compared": "6 contact orders", "bound": "12\u00a0%"}
    old = {
        "messages": {"sentence": {"code": code, "values": values}},
        "notes": [{"what": "contacts", "reason": "They were.", "code": code,
                   "values": values}],
    }  # fmt: skip
    assert worded(verdict(**old), "sentence") == verdict()["sentence"]
    page = Page(build_report(full_study(verdict=verdict(**old))))
    assert "No difference larger than 0.12 of the map, at 95 %" in page.text
    assert "They were." in page.text


def test_a_verdict_of_this_version_is_worded_anew():
    said = Message("maps.outlook_never", {"seen": "Nothing", "asked": "20 %"})
    message = {"outlook": {"code": said.code, "values": said.values}}
    assert worded(verdict(messages=message), "outlook") == said
    assert worded(verdict(), "outlook") == verdict()["outlook"]
    assert worded(verdict(), "main_contrast") == ""


def test_rows_above_the_bound_of_the_answer_are_explained():
    pair = {"of": "map", "first": "1>2", "second": "2>1", "estimate": 0.04}
    pair |= {"low": 0.0, "high": 0.21, "p_value": 1.0}
    pair |= {"n_first": 310, "n_second": 390}
    none = orders_table(verdict(orders=[pair])).note.text().replace("\u00a0", " ")
    assert "Landings are counted among the 700 that were fitted, of 986" in none
    assert "The answer's bound, 12 % (one-sided), is of all orders together" in none
    found = orders_table(verdict(orders=[pair], conclusion="different")).note.text()
    assert "700" in found
    assert "answer's bound" not in found


def saturating(**changes):
    """Return a verdict on a difference that fades before the feet are far apart."""
    over = verdict()["effect"] | {"estimate": 0.21, "low": 0.12, "high": 0.31}
    contact = over | {"estimate": 0.37, "high": None, "upper_bound": None}
    found = {"conclusion": "different", "saturates": True, "effect": contact}
    return verdict(**found, effect_over_landings=over, **changes)


def of_two_feet(first, second, of="map"):
    pair = {"of": of, "first": first, "second": second, "estimate": 0.2, "low": 0.1}
    return pair | {"high": 0.31, "p_value": 0.001, "n_first": 30, "n_second": 39}


def test_rows_of_maps_are_said_to_be_over_the_landings_and_open_at_the_contact():
    orders = [of_two_feet("1>2", "2>1")]
    found = orders_table(saturating(orders=orders)).note.text().replace("\u00a0", " ")
    assert "relative difference of their derivatives over these landings." in found
    assert "Where all feet touch at once each may be larger" in found
    assert "at least 12 %, is of all pairs together" in found
    page = Page(build_report(full_study(verdict=saturating(orders=orders))))
    assert "two maps may differ more: differences are found to fade" in page.text

    lasting = verdict(conclusion="different", orders=orders)
    note = orders_table(lasting).note.text()
    assert "over these landings" in note
    assert "all feet touch at once" not in note
    page = Page(build_report(full_study(verdict=lasting)))
    assert "two maps may differ more" not in page.text


def test_the_estimate_that_the_figure_marks_is_told_with_what_may_be_printed():
    text = Page(build_report(full_study(verdict=saturating()))).text
    text = text.replace("\u00a0", " ")
    assert "the estimate in it, 37 %, is extrapolated" in text
    assert "where all feet touch at once, 37 %, is extrapolated" in text
    assert "Print at least 12 % there" in text
    assert "(a) The difference between the maps of the contact orders, where" in text
    unsure = saturating() | {"conclusion": "cannot tell"}
    text = Page(build_report(full_study(verdict=unsure))).text
    assert "37" not in text.replace("\u00a0", " ").split("Quality of the data")[0]
    lasting = verdict(conclusion="different")
    assert "extrapolated" not in Page(build_report(full_study(verdict=lasting))).text


def test_either_order_of_two_feet_of_more_does_not_read_like_a_whole_order():
    together = of_two_feet("1>2, 4>3", "2>1, 3>4", "jump")
    orders = [of_two_feet("1>2", "2>1"), together]
    feet = ("FL", "FR", "RL", "RR")
    rows = orders_table(verdict(n_feet=4, orders=orders), feet).rows
    assert rows[0][1] == "FL before FR, or the reverse"
    assert rows[1][1] == "FL before FR, RR before RL, or the reverse"
    of_two = orders_table(verdict(n_feet=2, orders=orders[:1]), ("L", "R")).rows
    assert of_two[0][1] == "L → R and R → L"
    whole = of_two_feet("1>2>3", "2>1>3")
    of_three = orders_table(verdict(n_feet=3, orders=[whole])).rows
    assert of_three[0][1] == "1 → 2 → 3 and 2 → 1 → 3"


def test_the_figure_of_orders_has_a_letter_for_each_panel():
    rows = [{"of": "map"}, {"of": "map"}, {"of": "jump"}]
    assert verdict_facts(verdict(orders=rows))["kinds"] == ["map", "jump"]
    assert verdict_facts(None)["kinds"] == []


def test_what_own_maps_gain_is_said_in_one_sentence():
    row = {"outcome": "climb", "unit": "mm/s", "order": "2>1", "n_landings": 621}
    row |= {"n_orders": 2, "missed_by_one": 40.0, "gain": 10.0, "gain_high": 12.0}
    gained = pd.DataFrame([row | {"gain_low": 8.0}, row | {"gain_low": -1.0}])
    said = one_or_own_table(gained).note.text().replace("\u00a0", " ")
    assert "predict 1 of 2 outcomes better" in said
    assert "for climb, by 10 mm/s where one map misses by 40 mm/s" in said
    assert "(95 % interval, which holds for each outcome alone)" in said
    nothing = one_or_own_table(gained.assign(gain_low=-1.0)).note.text()
    assert "predict none of these outcomes better" in nothing


def test_where_own_maps_gain_without_a_difference_it_is_said_how_both_are_true():
    row = {"outcome": "climb", "unit": "mm/s", "order": "2>1", "n_landings": 621}
    row |= {"n_orders": 2, "missed_by_one": 40.0, "gain": 10.0, "gain_high": 12.0}
    gained = pd.DataFrame([row | {"gain_low": 8.0}])
    of_none = gained.assign(gain_low=-1.0)
    known = verdict()
    known["effect"] |= {"allowed": 0.101}

    def said(table, answer):
        return (
            one_or_own_table(table, verdict=answer).note.text().replace("\u00a0", " ")
        )

    assert "agrees with the answer: it excludes differences above 12 %" in said(
        gained, known
    )
    unsure = known | {"conclusion": "cannot tell"}
    assert "does not decide the question" in said(gained, unsure)
    assert "may seem to differ by up to 10 %" in said(gained, known)
    different = known | {"conclusion": "different"}
    assert "though the maps differ. This is no contradiction" in said(
        of_none, different
    )
    assert "contradiction" not in said(of_none, known)
    for table, answer_to_it in (
        (gained, different),
        (gained, no_answer()),
        (gained, None),
        (of_none, known),
    ):
        assert "of third order, by which" not in said(table, answer_to_it)


def test_a_bound_below_what_is_found_in_most_studies_is_explained():
    known = verdict()
    known["effect"] |= {"upper_bound": 0.126, "detectable": 0.182}
    told = [one.text().replace("\u00a0", " ") for one in reach(known)]
    assert any(one.startswith("The bound, 13 %, says how this study") for one in told)
    known["effect"] |= {"upper_bound": 0.19}
    assert not any("The bound, " in one.text() for one in reach(known))
    known["effect"] |= {"upper_bound": 0.126}
    different = known | {"conclusion": "different"}
    assert not any("The bound, " in one.text() for one in reach(different))


def test_a_bound_below_what_is_allowed_for_is_explained():
    known = verdict()
    known["effect"] |= {"upper_bound": 0.093, "allowed": 0.1}
    told = " ".join(str(one) for one in reach(known)).replace("\u00a0", " ")
    assert "below 10 %, up to which no difference is ever found" in told
    assert "95 % is the least confidence" in told
    known["effect"] |= {"upper_bound": 0.12}
    assert "ever found" not in " ".join(str(one) for one in reach(known))


def test_what_the_answer_leaves_open_stands_apart_in_ms():
    values = {
        "compared": "6 contact orders",
        "where": " over these landings",
    }
    values |= {"bound": "13 %", "confidence": "95 %", "margin": "20 %"}
    message = {"code": "maps.no_difference_at_contact", "values": values}
    values |= {"spreads": "0.73"}
    known = verdict(messages={"sentence": message}, sentence="As written.")
    known |= {"holds_from": 0.00814, "contact_spread": 0.0112}
    said, reservation = answer(known)
    assert str(said).endswith("over these landings, at 95 % confidence.")
    head = Page(build_report(full_study(verdict=known))).text.partition("At a glance")
    words = str(reservation).replace("\u00a0", " ")
    assert "spent once contacts are some 8.1 ms apart" in words
    assert words.endswith("Over landings such as these, the answer holds all the same.")
    assert words in head[0].replace("\u00a0", " ")
    assert "contact spreads" not in head[0]
    assert answer(verdict()) == [verdict()["sentence"]]


def test_what_holds_at_the_contact_stands_apart():
    values = {"compared": "6 contact orders", "size": "70 %", "where": ""}
    values |= {"low": "42 %", "high": "90 %", "confidence": "95 %", "rms": ""}
    different = {"code": "maps.different", "values": values}
    no_upper_end = {"code": "maps.no_upper_end", "values": {"low": "42 %"}}
    parts = {"different": different, "reservation": no_upper_end}
    message = {"code": "maps.different_reserved", "values": parts}
    said, reservation = answer(verdict(messages={"sentence": message}))
    assert str(said).endswith("interval 42 % to 90 %).")
    assert str(reservation).startswith("Where all feet touch at once it is at least 42")

    # A reservation of another version has no template: the sentence is all there is.
    parts["reservation"] = {"code": "maps.of_another_version", "values": {}}
    assert answer(verdict(messages={"sentence": message})) == [verdict()["sentence"]]


def test_a_small_p_value_without_saturation_is_explained():
    effect = verdict()["effect"] | {"allowed": 0.1}
    small = {"effect": effect, "saturates": False, "saturation_p_value": 0.0005}
    told = [str(one) for one in reach(verdict(**small))]
    assert any("p = 0.0005, and yet" in one and "10" in one for one in told)
    assert SATURATES_BELOW == LEVEL
    for other in ({"saturation_p_value": 0.02}, {"decided_by": "jump", "jump": effect}):
        told = [str(one) for one in reach(verdict(**small | other))]
        assert not any("and yet" in one for one in told)


def test_a_difference_that_fades_towards_the_contact_has_one_reading():
    """The test for saturation may have a small p-value beside it."""
    effect = verdict()["effect"] | {"allowed": 0.1}
    small = {"effect": effect, "saturates": False, "saturation_p_value": 0.0005}
    fading = Growth(slope=1.0, low=limits.GROWS + 0.1, high=1.5)
    unknown = Growth(slope=0.5, low=limits.GROWS - 0.1, high=limits.CURVATURE)
    lasting = Growth(slope=0.0, low=-0.1, high=limits.CURVATURE - 0.1)
    for growth, is_told in ((fading, False), (unknown, True), (lasting, True)):
        notes = [note.to_dict() for note in limits.grows(growth)]
        told = reach(verdict(**small, notes=notes))
        assert any("and yet" in str(one) for one in told) == is_told, growth


def test_a_difference_is_told_with_the_scale_down_to_which_it_holds():
    known = verdict(conclusion="different", contact_spread=0.0112)
    said, scale = answer(known)
    assert said == known["sentence"]
    assert "spread by 11 ms (standard deviation" in str(scale).replace("\u00a0", " ")
    assert answer(verdict(contact_spread=0.0112)) == [verdict()["sentence"]]
    jump = {"decided_by": "jump", "jump": verdict()["effect"]}
    assert answer(known | jump) == [known["sentence"]]


NAMED_JUMP = {**verdict()["effect"], "low": 0.05}
NO_JUMP = {**verdict()["effect"], "low": 0.0}


@pytest.mark.parametrize("decided_by", ["jump", "effect"])
@pytest.mark.parametrize(
    ("notes", "told"),
    [
        ([], "steps within a fifth of the contact spread (here 2.2 ms)"),
        (
            [{"what": "", "reason": "", "code": "maps.jump_or_bend", "values": {}}],
            "bends within the contact spread (here 11 ms)",
        ),
    ],
)
def test_a_jump_is_named_with_the_smooth_maps_that_look_like_it(
    decided_by, notes, told
):
    known = verdict(
        conclusion="different",
        decided_by=decided_by,
        contact_spread=0.0112,
        notes=notes,
        jump=NAMED_JUMP,
        orders=[{"of": "jump", "first": "1", "second": "2", **NAMED_JUMP}],
    )
    said = [str(one).replace("\u00a0", " ") for one in answer(known)]
    assert told in said[-1]
    assert len(said) == 2 + (decided_by == "effect")
    assert told in verdict_facts(known)["like_jump"].replace("\u00a0", " ")
    for without in ({"jump": NO_JUMP}, {"jump": None}, {"contact_spread": None}):
        other = known | without | {"decided_by": "effect"}
        assert verdict_facts(other)["like_jump"] is None
        assert not any("that jumps" in str(one) for one in answer(other))


def test_a_size_above_the_map_is_rounded_as_in_the_sentence():
    one = verdict()
    wide = {"estimate": 0.7012, "low": 0.4183, "high": 1.2271}
    facts = verdict_facts({**one, "effect": {**one["effect"], **wide}})
    assert facts["difference"] == "70 (41 to 123)\u00a0%"


@pytest.mark.parametrize(
    ("code", "told"),
    [
        ("foretold", "How the contacts vary is foretold to 99 % before the landing."),
        ("states", ""),
    ],
)
def test_orders_that_a_figure_shows_are_not_listed_in_a_sentence(code, told):
    values = {"orders": "heel → toe (27), toe → heel (23)", "share": "99 %"}
    known = {"messages": {"contacts": {"code": f"maps.so_far_{code}"}}}
    known["messages"]["contacts"]["values"] = values
    assert str(contacts_told(known)) == told
    assert contacts_told({"contacts": "as written"}) == "as written"


def test_what_an_interval_leaves_open_is_told_in_milliseconds():
    one = verdict() | {"conclusion": "different", "twice_high_from": 0.0065}
    size = {"code": "maps.different", "values": {"compared": "6 contact orders"}}
    size["values"] |= {"size": "67 %", "where": "", "confidence": "95 %"}
    size["values"] |= {"low": "42 %", "high": "87 %", "rms": "rms over all pairs; "}
    open_end = {"code": "maps.may_be_larger"}
    open_end["values"] = {"twice": "175 %", "spreads": "0.59"}
    values = {"different": size, "reservation": open_end}
    sentence = {"code": "maps.different_reserved", "values": values}
    told = [str(part) for part in answer({**one, "messages": {"sentence": sentence}})]
    assert told[0].endswith("(rms over all pairs; 95 % interval 42 % to 87 %).")
    assert (
        "more than 175 % if it is spent once contacts are some 6.5\u00a0ms" in told[1]
    )


def exchanges_of(number):
    """Return a verdict of this many exchanges, of which a jump of 9 % is found."""
    feet = [f"{foot}>{foot + 1}" for foot in range(1, number + 1)]
    sizes = {"estimate": 0.01, "low": 0.0, "high": 0.06, "p_value": 1.0}
    jumps = [{"of": "jump", "first": one, "second": one[::-1], **sizes} for one in feet]
    pair = {"of": "map", "first": "1>2", "second": "2>1", **sizes}
    return verdict(
        orders=[pair, *jumps], jump=verdict()["effect"] | {"detectable": 0.09}
    )


def said_of(known):
    return " ".join(str(one) for one in reach(known)).replace("\u00a0", " ")


def test_what_single_jump_would_be_found_is_said():
    """The size of jumps is an rms over N exchanges: one alone shows as 1/N^(1/2)."""
    assert "A jump of 9 % (rms over 4 exchanges) would be found in 80 % of such" in (
        said_of(exchanges_of(4))
    )
    assert said_of(exchanges_of(4)).endswith("that jump has to be about 18 %.")
    one = said_of(exchanges_of(1))
    assert "a jump of 9 % would be found in 80 %" in one
    assert "rms over" not in one


def test_beside_an_outlook_on_jumps_only_the_single_one_is_said():
    decides = {"decided_by": "jump", "conclusion": "different"}
    said = said_of(exchanges_of(4) | decides)
    assert said.startswith("The jump that would be found is an rms over 4 exchanges")
    assert "about 18 %" in said
    assert "jump" not in said_of(exchanges_of(1) | decides)


def test_without_exchanges_or_hope_no_jump_is_said():
    assert "jump" not in said_of(exchanges_of(0))
    assert "jump" not in said_of(exchanges_of(4) | {"jump": None})
    hopeless = {"jump": verdict()["effect"] | {"detectable": 1.4}}
    assert "jump" not in said_of(exchanges_of(4) | hopeless)


def test_a_p_value_of_one_is_told_as_above_099():
    shown = orders_table(exchanges_of(1))
    assert shown.rows[0][-1] == ">0.99"
    assert "of a size at most as large as a smooth map may leave" in shown.note.text()


def test_a_jump_is_said_of_the_outcome_only():
    assert "step of the derivative" in str(meaning(verdict()))
    assert "jump" not in str(meaning(verdict()))
    assert "jump of the map's derivative" not in build_report(full_study())


def test_single_orders_are_a_family_of_their_own():
    order = {"of": "order", "first": "1>2>3", "second": "others", "estimate": 0.01}
    order |= {"low": 0.0, "high": 0.1, "p_value": 0.4}
    known = exchanges_of(3)
    with_orders = verdict(orders=[*known["orders"], order])
    assert "as a family of their own" in orders_table(with_orders).note.text()
    assert "family" not in orders_table(known).note.text()
