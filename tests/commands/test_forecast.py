"""`hopdata check` forecasts what a study will find, and suggests changes.

`benchmarks/check_forecast.py` and `tests/workflow` test that the numbers are those of
the study.
"""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from made_up_files import export
from made_up_hopper import hopping, with_gap

from hopdata.__main__ import main
from hopdata.commands import forecast
from hopdata.landings import exclusion
from hopdata.maps.verdict.inputs import landings_for_terms
from hopdata.messages import Message

STUDY = """study: trial
recordings:
  - {{name: one, file: {file}}}
markers: {{body: [hip1, hip2, hip3], feet: [toe1, toe2, toe3]}}
"""


@pytest.fixture
def check(tmp_path, capsys):
    """Return a function that checks positions: exit code, lines of the forecast, and errors."""

    def checked(positions):
        config = tmp_path / "study.yaml"
        config.write_text(STUDY.format(file=export(tmp_path, positions)))
        code = main(["check", str(config)])
        told = capsys.readouterr()
        lines = [line.strip() for line in told.out.splitlines()]
        return (
            code,
            lines[lines.index("forecast") :] if "forecast" in lines else [],
            told.err,
        )

    return checked


def starting(lines, word):
    return [line.removeprefix(word).strip() for line in lines if line.startswith(word)]


def test_few_landings_are_counted_and_more_are_asked_for(check):
    code, lines, _ = check(None)
    assert code == 0
    (landings,), (verdict,) = starting(lines, "landings"), starting(lines, "verdict")
    used, of, found = landings.split()[:3]
    assert of == "of"
    assert 28 <= int(used) <= int(found) <= 34
    assert re.search(
        r"will be used, \d+ % of their orders unsure; contacts timed: ", landings
    )
    assert landings.endswith("toe1 100 %, toe2 100 %, toe3 100 %")
    assert verdict.startswith("out of reach: ")
    assert (
        "expected at least 150 touchdowns with known states and contacts, found "
        in verdict
    )
    (more,) = starting(lines, "change")
    assert more.startswith(
        "record more: at least 150 landings before anything can be compared"
    )


@pytest.mark.parametrize(
    ("orders", "varies"), [(("1>2>3",), 1), (("1>2>3", "3>2>1"), 0)]
)
def test_only_landings_that_are_alike_are_to_be_varied(orders, varies):
    columns = {
        "schedule": orders * 15,
        "order_class": orders * 15,
        "excluded": False,
        "reason": "",
    }
    touchdowns = pd.DataFrame(columns | {f"contact_{foot}_s": 0.0 for foot in "abc"})
    markers, verdict = (
        {"body": [], "feet": ["a", "b", "c"]},
        {"margin": 0.2, "power": 0.8},
    )
    config = {
        "markers": markers,
        "verdict": verdict,
        "feet": [],
        "sections": {"rule": "landings"},
    }
    found = forecast.Forecast(
        touchdowns, 1.0, reason="few orders", code=forecast.TOO_FEW_ORDERS
    )
    lines = forecast.describe(found, config, [])
    assert found.vain.startswith("its verdict is out of reach; contacts with errors")
    unsure = forecast.Forecast(
        touchdowns.assign(**{"order_class": "ambiguous"}), 1.0, 0.1
    )
    assert unsure.vain == "100 % of its contact orders are unsure"
    assert forecast.Forecast(touchdowns, 1.0, 0.1).vain == ""
    mixed = forecast.Forecast(touchdowns, 1.0, 0.1, kinds="by their velocity")
    assert (
        "  note      landings are of two kinds by their velocity"
        in forecast.describe(mixed, config, [])
    )
    assert not any("two kinds" in line for line in lines)
    bouncing = forecast.Forecast(touchdowns, 1.0, 0.1, contact_remarks=("a bounces",))
    assert "  note      a bounces" in forecast.describe(bouncing, config, [])
    assert not starting([line.strip() for line in lines], "note")
    changes = starting([line.strip() for line in lines], "change")
    assert sum(one.startswith("vary how the body lands") for one in changes) == varies


def test_the_foot_that_makes_orders_unsure_is_named():
    feet = ["a", "b", "c"]
    columns = {
        "schedule": "1>2>3",
        "order_class": "ambiguous",
        "excluded": False,
        "reason": "",
    }
    instants = {"contact_a_s": 0.0, "contact_b_s": 1e-4, "contact_c_s": 0.02}
    errors = {f"se_{foot}_s": 1e-3 for foot in feet}
    touchdowns = pd.DataFrame(columns | instants | errors, index=range(30))
    found = forecast.Forecast(touchdowns, 1.0, reason="no order is sure")
    shares = [found.unsure_without(foot, feet, 0.9) for foot in feet]
    assert shares == [0.0, 0.0, 1.0]
    config = {
        "markers": {"body": [], "feet": feet}, "verdict": {"margin": 0.2}, "feet": [],
        "sections": {"rule": "landings"},
        "touchdowns": {"ambiguous_below": 0.9},
    }  # fmt: skip
    changes = starting(
        [line.strip() for line in forecast.describe(found, config, [])], "change"
    )
    assert changes[0] == "take a off markers.feet: of the others' orders 0 % are unsure"
    sure = forecast.Forecast(
        touchdowns.assign(**{"order_class": "1>2>3"}), 1.0, reason="none"
    )
    assert not any("take a off" in line for line in forecast.describe(sure, config, []))


def test_a_foot_that_is_hidden_where_it_lands_is_named(check):
    positions = hopping(1)[1]
    for start in range(0, len(positions), 100):
        positions = with_gap(positions, "toe2", start, start + 50)
    _, lines, _ = check(positions)
    used, _, found = starting(lines, "landings")[0].split()[:3]
    assert int(used) < 0.8 * int(found)
    assert "frames missing at the contact of toe2" in starting(lines, "left out")[0]
    assert any(
        x.startswith("toe2 is hidden where it lands") for x in starting(lines, "change")
    )
    # The others are not hidden. That one of them may be left out since orders are
    # unsure is another advice, which depends on chance in 15 landings.
    assert not any(x.startswith(("toe1", "toe3")) for x in starting(lines, "change"))


def test_a_foot_that_only_drags_is_to_be_left_out():
    reason = "body stayed below the pre section"
    columns = {
        "schedule": "1>2>3",
        "order_class": "1>2>3",
        "excluded": True,
        "reason": reason,
    }
    instants = {"contact_a_s": 0.0, "contact_b_s": np.nan, "contact_c_s": 0.02}
    found = forecast.Forecast(
        pd.DataFrame(columns | instants, index=range(30)), 1.0, stops=True
    )
    config = {
        "markers": {"body": [], "feet": ["a", "b", "c"]}, "verdict": {"margin": 0.2}, "feet": [],
        "sections": {"rule": "landings"},
    }  # fmt: skip
    changes = starting(
        [line.strip() for line in forecast.describe(found, config, [])], "change"
    )
    assert changes == ["b is hardly ever seen to land: take it off markers.feet"]


def test_feet_that_never_come_down_to_the_floor_are_told():
    columns = {
        "reason": "no foot of the study landed",
        "excluded": True,
        "contact_a_s": np.nan,
    }
    found = forecast.Forecast(pd.DataFrame(columns, index=range(9)), 1.0, stops=True)
    config = {
        "markers": {"body": ["hip"], "feet": ["a"]},
        "verdict": {"margin": 0.2},
        "sections": {"rule": "landings"},
        "feet": [],
    }
    changes = starting(
        [line.strip() for line in forecast.describe(found, config, [])], "change"
    )
    assert len(changes) == 1
    assert "touchdowns.down_height_m" in changes[0]


def test_where_no_height_holds_the_landings_none_is_to_be_set():
    table = pd.DataFrame(
        {
            "reason": "post section never reached",
            "excluded": True,
            "order_class": "",
            "schedule": "1>2>3",
        }
        | {f"contact_{foot}_s": 0.0 for foot in "abc"},
        index=range(9),
    )
    config = {
        "markers": {"body": [], "feet": ["a", "b", "c"]}, "verdict": {"margin": 0.2}, "feet": [],
        "sections": {"rule": "landings"},
    }  # fmt: skip
    for share, advice in (
        (0.05, "at no height are all feet down in more than 5 % of the landings: drop"),
        (0.9, "set sections.post_height_m"),
    ):
        found = forecast.Forecast(table, 1.0, stops=True, best={"post": share})
        told = [line.strip() for line in forecast.describe(found, config, [])]
        (change,) = (
            x
            for x in starting(told, "change")
            if x.startswith("the body does not sink")
        )
        assert advice in change
        assert "sections.rule" not in change
    printed = config | {"sections": {"rule": "printed"}}
    told = [
        line.strip()
        for line in forecast.describe(forecast.Forecast(table, 1.0), printed, [])
    ]
    (change,) = (
        x for x in starting(told, "change") if x.startswith("the body does not sink")
    )
    assert "set sections.post_height_m, or sections.rule to landings" in change


def test_without_a_landing_no_share_of_them_is_timed():
    none = pd.DataFrame(
        {"reason": ["no foot of the study landed"], "contact_toe_s": [np.nan]}
    )
    assert forecast.Forecast(none, 1.0, stops=True).timed("toe") == 0.0


def test_a_body_marker_that_is_lost_is_named(check):
    _, lines, _ = check(with_gap(hopping(1)[1], "hip3", 1200, 2000))
    (told,) = (
        x
        for x in starting(lines, "change")
        if x.startswith("hip3 is hidden as the body")
    )
    assert "take it off" not in told  # three are the minimum


def test_a_study_of_two_landings_gets_its_contacts_and_what_maps_need(check):
    code, lines, errors = check(hopping(1)[1][:130])
    assert code == 0
    assert starting(lines, "verdict")[0].startswith(
        "out of reach: pairs: expected at least 3"
    )
    assert errors == ""
    told = "\n".join(lines)
    assert "6 contacts in 2 landings" in told
    assert "too few landings for maps and a verdict: 2 found, at least 3" in told
    assert "can be run, but it will give contacts only" in told


def test_feet_that_never_fly_are_an_error_before_any_forecast(check):
    positions = hopping(1)[1]
    positions[:, 3:6, 2] = np.random.default_rng(0).normal(0, 6e-4, (len(positions), 3))
    code, lines, errors = check(positions)
    assert (code, lines) == (1, [])
    assert "the feet never leave the ground together" in errors
    assert "moves" not in errors


def resting_at_both_ends(positions, n_frames):
    """Return positions before and after which the body stands for `n_frames` each."""
    rng = np.random.default_rng(5)
    standing = positions[[np.abs(positions[:, :3, 2].mean(axis=1) - 0.3).argmin()]]
    still = np.repeat(standing, 2 * n_frames, axis=0)
    still += rng.normal(0, 6e-4, still.shape)
    return np.concatenate([still[:n_frames], positions, still[n_frames:]])


@pytest.mark.parametrize("n_resting", [0, 1000, 3000])
def test_of_long_studies_the_middle_is_looked_at_and_counts_are_scaled(
    check, monkeypatch, n_resting
):
    positions = resting_at_both_ends(hopping(2, n_frames=12_000)[1], n_resting)
    whole = starting(check(positions)[1], "landings")[0].split()
    monkeypatch.setattr(forecast, "ENOUGH", 0.0)
    monkeypatch.setattr(forecast, "MOST_FRAMES", 0.8 * len(positions))
    told = starting(check(positions)[1], "landings")[0]
    part = told.split()
    assert part[0] == "about"
    assert "by the middle 80 % of each recording" in told
    # As far as the ends of the part cut a landing in two.
    assert int(part[1]) == pytest.approx(int(whole[0]), rel=0.015)


def test_a_part_with_too_few_landings_for_a_verdict_is_made_longer(check, monkeypatch):
    positions = hopping(2, n_frames=12_000)[1]
    monkeypatch.setattr(forecast, "MOST_FRAMES", 3000)
    lines = check(positions)[1]
    (verdict,) = starting(lines, "verdict")
    assert "expected at least" not in verdict
    # Without landings enough, all frames are examined, and the numbers are of one count.
    few = hopping(2, n_frames=6000)[1]
    monkeypatch.setattr(forecast, "MOST_FRAMES", 1500)
    lines = check(few)[1]
    (landings,) = starting(lines, "landings")
    (verdict,) = starting(lines, "verdict")
    assert not landings.startswith("about")
    assert f"found {landings.split()[0]}" in verdict


def test_what_is_seen_says_how_near_the_verdict_is():
    config = {"verdict": {"margin": 0.2, "power": 0.8}}
    told = {
        seen: str(forecast.reach(forecast.Forecast(pd.DataFrame(), 1.0, seen), config))
        for seen in (0.1, 0.25, 0.4, 2.0)
    }
    starts = ("in reach: ", "in doubt: ", "in reach only if", "out of reach: ")
    assert all(
        x.startswith(start) for x, start in zip(told.values(), starts, strict=True)
    )
    assert "a difference of 25 % of the map shows in 80 % of such studies" in told[0.25]


def lost_for(reason, feet=("a", "b")):
    """Return a forecast and configuration with 20 landings, ten of them lost."""
    columns = {"schedule": "1>2", "order_class": "1>2"}
    table = pd.DataFrame(columns, index=range(20))
    for foot in feet:
        table[f"contact_{foot}_s"] = 0.0
    table["excluded"] = table.index < 10
    table["reason"] = np.where(table["excluded"], reason, "")
    config = {
        "markers": {"body": [], "feet": list(feet)},
        "verdict": {"margin": 0.2, "power": 0.8},
        "feet": [],
        "sections": {"rule": "landings"},
    }
    return forecast.Forecast(table, 1.0, detectable=0.1), config


def test_few_landings_are_not_told_that_a_margin_is_out_of_reach_of_many():
    """More is allowed in the wide window of few landings than in that of many."""
    few, config = lost_for("body stayed below the pre section")
    touchdowns = pd.concat(
        [few.touchdowns] * 40, ignore_index=True
    )  # 400 of 800 are used
    few = replace(few, touchdowns=touchdowns, detectable=0.5, allowed=0.25)

    def advice(found):
        changes = forecast.changes(found, config, [])
        return {change.code: change.values for change in changes}

    assert advice(few)["commands.larger_margin"] == {"allowed": 0.25}
    seen = advice(replace(few, detectable_nearest=0.6, allowed_nearest=0.1))
    assert "commands.larger_margin" not in seen
    # What is left of 400 landings by the terms, times (0.5 / 0.1)^2, and the terms.
    for_terms = landings_for_terms(2)
    needed = for_terms + (400 - for_terms) * 25
    landings = seen["commands.record_landings"]["landings"]
    assert landings == float(f"{needed:.2g}")
    far = advice(replace(few, detectable_nearest=0.6, allowed_nearest=0.21))
    assert far["commands.larger_margin"] == {"allowed": 0.21}


def test_landings_enough_are_those_of_twice_a_size():
    def is_of_enough(examined):
        found = forecast.Forecast(
            pd.DataFrame(), 1.0, judged_examined=examined, n_feet=3
        )
        return found.is_of_enough

    assert [is_of_enough(number) for number in (299, 300, None)] == [False, True, True]


@pytest.mark.parametrize(
    ("allowed", "least", "most"), [(0.1, 1.0, 1.3), (0.14, 1.4, 1.3), (0.16, 1.6, None)]
)
def test_the_number_asked_for_has_a_range_that_widens_near_the_margin(
    allowed, least, most
):
    few, config = lost_for("body stayed below the pre section", feet="abc")
    found = replace(
        few,
        detectable=allowed + 0.2,
        allowed=allowed,
        judged=700,
        judged_examined=320,
        n_feet=3,
    )
    (change,) = (
        one
        for one in forecast.changes(found, config, [])
        if one.code == "commands.record_landings"
    )
    for_terms = landings_for_terms(3)

    def needed(left, noise_within=1.0):
        number = for_terms + (700 - for_terms) * (0.2 / (0.2 - left)) ** 2
        return float(f"{noise_within * number:.2g}")

    assert change.values["landings"] == needed(allowed)
    at_least = needed(allowed / least, 1 / forecast.NOISE_WITHIN)
    assert change.values["least"] == pytest.approx(at_least, rel=0.01)
    if most is None:
        assert "so many that none is enough" in str(change)
    else:
        at_most = needed(most * allowed, forecast.NOISE_WITHIN)
        assert change.values["most"] == f"{at_most:,.0f}"
    assert "this rests on 320 judged landings" in str(change)


def test_no_more_is_asked_for_where_the_landings_may_be_enough():
    """By the range of the forecast; with noise that is too much for it, more is."""
    few, config = lost_for("body stayed below the pre section", feet="abc")

    def advice(beyond):
        found = replace(
            few,
            detectable=0.15 + beyond,
            allowed=0.15,
            judged=700,
            judged_examined=320,
            n_feet=3,
        )
        changes = forecast.changes(found, config, [])
        return {change.code: change for change in changes}

    may_do = advice(0.08)
    assert "commands.record_landings" not in may_do
    assert may_do["commands.landings_may_do"].values["judged"] == 700
    more = advice(0.2)
    assert "commands.landings_may_do" not in more
    assert more["commands.record_landings"].values["least"] > 700


def test_a_part_of_few_judged_landings_is_made_longer(monkeypatch):
    """As long as there are more; then the whole study is told of."""
    examined = []

    def of_frames(config, recordings, most_frames):
        del config, recordings
        examined.append(most_frames)
        n_judged = round(most_frames / 1000)
        return forecast.Forecast(
            pd.DataFrame(), 1.0, 0.3, judged_examined=n_judged, n_feet=3
        )

    monkeypatch.setattr(forecast, "_of_frames", of_frames)
    monkeypatch.setattr(forecast, "MOST_FRAMES", 100_000)
    config = {"recordings": [{"exclude": []}]}
    recording = SimpleNamespace(time=np.arange(1_000_000))
    assert forecast.foretell(config, [recording]).judged_examined == 400
    assert examined == [100_000, 200_000, 400_000]


@pytest.mark.parametrize("code", forecast.CHANGES)
def test_every_change_answers_a_reason_that_the_tables_give(code):
    assert code in (*exclusion.OF_A_FOOT, *exclusion.OF_ALL_FEET)
    found, config = lost_for(Message(code, {"foot": 2}).text())
    (change,) = forecast.changes(found, config, [])
    assert change.code == forecast.CHANGES[code]
    assert change.values["foot"] == ("b" if code in exclusion.OF_A_FOOT else "")


def test_a_reason_by_hand_asks_for_no_change():
    """Though it may have the words of a reason that does, or a foot that is not there."""
    words = "by hand: foot 3 not down by the post section, as foot 2"
    found, config = lost_for(words)
    assert forecast.changes(found, config, []) == []
    (left_out,) = [
        line for line in forecast.describe(found, config, []) if "left out" in line
    ]
    assert left_out.endswith("by hand: foot 3 not down by the post section, as b: 10")


def test_without_landings_no_contact_is_timed():
    none = pd.DataFrame({"reason": [], "contact_toe_s": []})
    assert forecast.Forecast(none, 1.0).timed("toe") == 0


def test_the_codes_that_ask_for_other_orders_are_those_of_the_verdict():
    """Of messages that have templates, and not for the words that they are put in."""
    values = {
        "least": 10,
        "found": 9,
        "aside": "",
        "commonest": "1 → 2 has 9",
        "what_is_missing": "meet",
    }
    for code in (
        forecast.TOO_FEW_ORDERS,
        forecast.TOO_FEW_LANDINGS,
        forecast.NO_TWO_FEET,
    ):
        assert Message(code, values).text()
    columns = {"schedule": "1>2", "order_class": "1>2", "excluded": False, "reason": ""}
    touchdowns = pd.DataFrame(
        columns | {"contact_a_s": 0.0, "contact_b_s": 0.0}, index=range(30)
    )
    touchdowns.loc[:3, "schedule"] = "2>1"
    config = {
        "markers": {"body": [], "feet": ["a", "b"]},
        "verdict": {"margin": 0.2},
        "feet": [],
        "sections": {"rule": "landings"},
    }
    for code, varies in (
        (forecast.NO_TWO_FEET, 1),
        (forecast.TOO_FEW_LANDINGS, 1),
        ("maps.outcome_constant", 0),
    ):
        words = "no two feet, in one contact order"
        found = forecast.Forecast(touchdowns, 1.0, reason=words, code=code)
        changes = forecast.changes(found, config, [])
        codes = [change.code for change in changes]
        assert codes.count("commands.vary_the_order") == varies
        told = "that of 26 of 30 landings"
        assert sum(told in str(change) for change in changes) == varies
