"""Of a study that cannot tell, the one cause that limits it is named first."""

import os

import numpy as np
import pytest
from kinked_landings import landings, legs_and_feet

from hopdata.errors import AnalysisError
from hopdata.maps.verdict import judge
from hopdata.maps.verdict.what_now import limits_of_reason
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
