"""Of a study that cannot tell, the one cause that limits it is named first."""

import os
from dataclasses import replace

import numpy as np
import pytest
from kinked_landings import landings, legs_and_feet, seen_at_section

from hopdata.errors import AnalysisError
from hopdata.maps.verdict import judge
from hopdata.maps.verdict.model import fit_kinks
from hopdata.maps.verdict.what_now import (
    _Detectable,
    _of_noise,
    limits_of_reason,
    share_of_noise,
)
from hopdata.maps.verdict.words import asked_for
from hopdata.messages import Message

# Scatter of the legs, in contact spreads.
SCATTER = 1.0
SEEDS = range(1, 11) if "ALL" in os.environ else (1,)


def few(seed):
    data = landings(190, seed=seed, noise=0.4, curvature=0.0)
    return data.before, data.after, data.instants


def noisy(seed):
    """Return many landings whose body markers are seen badly."""
    data = landings(1500, seed=seed, curvature=0.0)
    rng = np.random.default_rng(seed + 50)
    noise = np.repeat([0.0015, 0.025], 9)
    seen = [
        states + noise * rng.standard_normal(states.shape)
        for states in (data.before, data.after)
    ]
    return *seen, data.instants


def drifting(seed):
    """Return landings whose speeds change in waves that no slow term follows."""
    data = landings(900, seed=seed, noise=0.02, curvature=0.0)
    rng = np.random.default_rng(seed)
    wave = np.sin(np.arange(900) / 15.0 + rng.uniform(0, 6))
    after = data.after.copy()
    after[:, 9::3] += 0.3 * wave[:, None]
    return data.before, after, data.instants


def with_posture(seed):
    """Return legs whose length varies, and whose feet are not seen before."""
    data, _ = legs_and_feet(1500, SCATTER, 0.0, seed=seed)
    return data.before, data.after, data.instants


def one_order(seed):
    data = landings(900, seed=seed, feet=2)
    first = data.instants[:, 0] < data.instants[:, 1]
    first[np.flatnonzero(~first)[:5]] = True
    return data.before[first], data.after[first], data.instants[first]


CAUSES = {
    "landings": few,
    "noise": noisy,
    "drift": drifting,
    "posture": with_posture,
    "orders": one_order,
}


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("cause", CAUSES)
def test_the_cause_that_limits_is_named_first(cause, seed):
    answer = judge(*CAUSES[cause](seed), seed=seed, flips=99)
    assert answer.conclusion == "cannot tell"
    first = answer.what_now[0]
    assert first["cause"] == cause
    assert first["said"].lower().startswith(cause)


def test_what_costs_more_stands_before_what_costs_less():
    answer = judge(*few(2), seed=1, flips=99, margin=0.15)
    costs = [one["costs"] for one in answer.what_now if one["costs"] is not None]
    assert costs == sorted(costs, reverse=True)


def test_a_study_that_can_tell_has_no_such_list():
    data = landings(900, seed=1)
    answer = judge(data.before, data.after, data.instants, seed=1, flips=99)
    assert answer.conclusion == "no difference"
    assert answer.what_now == []


def test_too_few_landings_are_told_with_the_number_that_is_missing():
    data = landings(100, seed=1)
    answer = judge(data.before, data.after, data.instants, seed=1, flips=99)
    (only,) = answer.what_now
    assert only["cause"] == "landings"
    assert (only["values"]["found"], only["values"]["least"]) == (100, 150)


def test_landings_that_were_lost_are_told_with_the_reason():
    """The page said so of landings that were left out, where its table had none."""
    data = landings(100, seed=1)
    whole = judge(data.before, data.after, data.instants, seed=1, flips=99)
    (only,) = whole.what_now
    assert only["code"] == "maps.none_for_landings"
    assert "left out" not in only["said"]
    assert "lost" not in only["values"]
    assert whole.gross_errors == {}

    instants = data.instants.copy()
    instants[3, 1] = np.nan
    before = data.before.copy()
    before[7] = np.nan
    after = data.after.copy()
    # A marker of the body is 0.2 m off.
    after[11, 0] += 0.2
    spoilt = judge(before, after, instants, seed=1, flips=99)
    (only,) = spoilt.what_now
    assert only["cause"] == "landings"
    assert only["values"]["found"] == 97
    assert only["values"]["lost"] == 3
    assert only["values"]["rows"] == {
        "without_state": [8],
        "without_contact": [4],
        "markers_apart": [12],
    }
    assert "Not counted, of the touchdowns used: 1 without a state" in only["said"]
    assert "1 without the contact of a foot" in only["said"]
    assert "1 with body markers that are not quite as far apart" in only["said"]
    assert spoilt.gross_errors == {"markers_apart": [12]}


def test_few_landings_in_one_order_need_a_second_order_too():
    too_few = AnalysisError(
        Message("maps.too_few_landings", {"least": 150, "found": 42, "aside": ""})
    )
    once = [{"order": "2 → 3 → 1", "landings": 42}]
    found = limits_of_reason(too_few, once)
    assert [one.cause for one in found] == ["orders", "landings"]
    assert "one order occurs, 2 → 3 → 1, in all 42 landings" in str(found[0].said)
    both = [*once, {"order": "1 → 2 → 3", "landings": 8}]
    assert [one.cause for one in limits_of_reason(too_few, both)] == ["landings"]


def with_a_high_estimate(margin):
    """Return the verdict on landings with a true difference that is not found."""
    data = landings(900, strength=0.1, seed=1)
    return judge(
        data.before, data.after, data.instants, seed=1, flips=99, margin=margin
    )


def test_a_study_with_enough_landings_is_not_told_to_record_fewer():
    """It was told to record 330 landings when it had 360, and could not tell."""
    enough = with_a_high_estimate(0.147)
    assert enough.conclusion == "cannot tell"
    assert enough.effect.detectable < 0.147 < enough.effect.upper_bound
    first, *others = enough.what_now
    assert (first["cause"], first["code"]) == ("estimate", "maps.limit_estimate")
    assert "landings" not in [one["cause"] for one in others]
    assert "900 landings are used, which are enough to show 15 %" in first["said"]
    assert "came out at 9.3 %" in first["said"]
    needed = enough.effect.landings_for_bound(900, 0.147, 3)
    assert needed > 900
    assert first["values"]["needed"] == f"{asked_for(needed, 900):,}"

    # An estimate from which no number of landings leads to the margin.
    never = with_a_high_estimate(0.14)
    assert never.conclusion == "cannot tell"
    assert never.what_now[0]["code"] == "maps.limit_estimate_no"

    # With too few for its power, it is asked for more than it has.
    more = with_a_high_estimate(0.13)
    assert more.conclusion == "cannot tell"
    assert more.effect.detectable > 0.13
    (said,) = [one for one in more.what_now if one["cause"] == "landings"]
    assert int(said["values"]["needed"].replace(",", "")) > 900
    assert "estimate" not in [one["cause"] for one in more.what_now]


def test_noise_is_not_asked_to_fall_to_all_of_itself():
    data = landings(600, noise=0.1)
    noise = np.repeat([0.0015, 0.025], 9)
    rng = np.random.default_rng(1)
    before = data.before + noise * rng.standard_normal(data.before.shape)
    section = seen_at_section(replace(data, before=before))
    fit = fit_kinks(section)
    codes = []
    share = share_of_noise(fit, section)
    least = 0.1 + 0.1 * np.sqrt(1.0 - share)
    for margin in (least - 0.001, least + 0.001, 0.21):
        limit = _of_noise(fit, section, _Detectable(0.1, 0.1, margin))
        codes.append(str(limit.said.code))
        assert "to 100 % of" not in str(limit.said)
    ends = ["limit_noise_no", "limit_noise", "limit_noise_some"]
    assert codes == [f"maps.{end}" for end in ends]


def test_no_study_is_asked_for_a_number_that_it_has():
    assert asked_for(334, 360) == 330
    assert asked_for(1049, 1020) == 1100
    assert asked_for(1049, 900) == 1000
    assert asked_for(150, 149) == 150
    for landings_used in range(100, 3000, 7):
        for needed in range(landings_used + 1, landings_used + 200, 9):
            assert asked_for(needed, landings_used) > landings_used
