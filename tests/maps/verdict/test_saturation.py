"""Kinks that are spent before the contacts are far apart."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.maps.verdict.kinked_landings import (
    fading_one_side,
    landings,
    smooth_steps,
)

from hopdata.maps.coordinates import kinks
from hopdata.maps.verdict import effect
from hopdata.maps.verdict.effect import EffectSize
from hopdata.maps.verdict.judge import judge
from hopdata.maps.verdict.saturation import (
    FASTEST,
    SLOWEST,
    TIME_CONSTANTS,
    Lasting,
    durations,
    kinks_of_durations,
    mean_saturated,
    saturated,
)

NO_REST = np.zeros((3, 3))


def study(spent_within=np.inf, strength=0.5, seed=1, n=900):
    """Return the verdict on landings whose kinks saturate after some contact spreads."""
    data = landings(
        n=n, strength=strength, spent_within=spent_within, curvature=0.0, seed=seed
    )
    errors = np.full_like(data.instants, 0.0004)
    return judge(
        data.before, data.after, data.instants, instants_se=errors, seed=1, flips=499
    )


def test_of_three_feet_one_is_alone_first_and_another_last():
    instants = np.array([[0.0, 1.0, 4.0], [2.0, 0.5, 0.5]])
    found = durations(instants)
    assert found.tolist() == [[1, 0, 0, 0, 0, 3], [0, 0, 0, 1.5, 0, 0]]


@pytest.mark.parametrize("feet", [2, 3, 4])
def test_durations_are_kinks_and_a_linear_part(feet):
    instants = np.random.default_rng(feet).standard_normal((200, feet))
    rest = durations(instants) - kinks(instants) @ kinks_of_durations(feet).T
    left = rest - instants @ np.linalg.lstsq(instants, rest, rcond=None)[0]
    assert np.abs(left).max() < 1e-12
    # A linear part alone would not do.
    alone = durations(instants)
    left = alone - instants @ np.linalg.lstsq(instants, alone, rcond=None)[0]
    assert np.abs(left).max() > 0.1


def test_a_term_that_saturates_starts_as_a_kink_and_ends_constant():
    assert saturated(np.array([1e-4]), 0.5) == pytest.approx(1e-4, rel=1e-6)
    assert saturated(np.array([50.0]), 0.5) == pytest.approx(0.5)


def test_terms_are_averaged_over_what_is_not_foretold():
    instants = np.array([[0.0, 0.1, 0.7], [0.4, -0.3, 0.2]])
    exact = saturated(durations(instants), TIME_CONSTANTS[0])
    assert mean_saturated(instants, NO_REST)[0] == pytest.approx(exact)

    rest = np.diag([0.1, 0.2, 0.15]) ** 2
    moves = np.random.default_rng(1).standard_normal((40_000, 3)) @ np.sqrt(rest)
    for mean, constant in zip(
        mean_saturated(instants, rest), TIME_CONSTANTS, strict=True
    ):
        for row, instant in zip(mean, instants, strict=True):
            drawn = saturated(durations(instant + moves), constant).mean(axis=0)
            assert row == pytest.approx(drawn, abs=0.01)


def test_the_least_time_constant_is_where_the_share_is_reached():
    shown = Lasting(np.array([SLOWEST, 1.0, FASTEST]), np.array([0.99, 0.5, 0.1]))
    assert shown.least_time_constant(0.5) == pytest.approx(1.0)
    assert shown.least_time_constant(0.995) is None
    assert shown.least_time_constant(0.05) == FASTEST
    between = np.sqrt(1.0 * SLOWEST)
    assert shown.least_time_constant(0.745) == pytest.approx(between)


@pytest.fixture(scope="module")
def lasting():
    return study()


@pytest.fixture(scope="module")
def brief():
    return study(spent_within=0.5)


def test_kinks_that_last_are_as_large_over_the_landings(lasting):
    assert not lasting.saturates
    assert lasting.effect == lasting.effect_over_landings


def test_kinks_that_saturate_are_found_and_measured_at_the_contact(lasting, brief):
    """Both have the same slope at the simultaneous contact."""
    assert brief.saturates
    assert brief.saturation_p_value < 0.01
    over_landings = brief.effect_over_landings
    assert over_landings.upper_bound < lasting.effect.estimate
    assert brief.effect.estimate > 1.5 * over_landings.estimate
    assert brief.effect.estimate == pytest.approx(lasting.effect.estimate, rel=0.2)
    assert brief.effect.low == over_landings.low
    assert "no upper end can be given" in brief.sentence
    assert "upper end" not in lasting.sentence


def test_rows_of_pairs_are_over_the_landings(lasting, brief):
    """Also where the size at the contact is another: pairs are not extrapolated."""
    for answer in (lasting, brief):
        sizes = [row["estimate"] for row in answer.orders if row["of"] == "map"]
        squared = np.mean(np.square(sizes))
        assert squared == pytest.approx(answer.effect_over_landings.squared)
    assert brief.effect.estimate**2 > 2.0 * brief.effect_over_landings.squared


def test_a_size_at_the_contact_has_no_upper_end_if_it_saturates(lasting, brief):
    """In JSON it is null, and comes back; elsewhere ends are finite."""
    assert brief.effect.high == brief.effect.upper_bound == math.inf
    assert not brief.effect.is_bounded
    assert brief.effect_over_landings.is_bounded
    assert lasting.effect.is_bounded
    content = json.loads(json.dumps(brief.effect.to_dict(), allow_nan=False))
    assert content["high"] is content["upper_bound"] is None
    assert EffectSize.from_dict(content) == brief.effect
    assert "without an upper end" in str(brief.effect)


def test_no_number_of_landings_is_promised_at_the_contact(lasting, brief):
    words = "for the simultaneous contact no number of landings is known"
    assert words in brief.outlook
    assert words not in lasting.outlook


def test_a_study_that_cannot_tell_names_saturation_before_landings():
    answer = study(strength=0.5, spent_within=0.2, n=600)
    assert answer.conclusion == "cannot tell"
    assert answer.saturates
    assert "no upper bound can be given" in answer.sentence
    codes = [one["code"] for one in answer.what_now]
    assert codes == ["maps.limit_saturation", "maps.limit_landings_saturates_enough"]


def test_a_smooth_map_seldom_saturates():
    found = [study(strength=0.0, seed=seed, n=400).saturates for seed in range(12)]
    assert sum(found) <= 1


def test_the_bound_says_what_it_does_not_cover():
    same = study(strength=0.0)
    assert same.conclusion == "no difference"
    spreads = same.holds_from / same.contact_spread
    assert 0.1 < spreads < 2.0
    words = (
        f"a difference that fades within {spreads:.2g} times the spread of the contacts"
    )
    assert words in same.sentence
    assert "over these landings" in same.sentence


def test_an_interval_says_what_it_leaves_open_at_the_contact(lasting, brief):
    """Where saturation is found, there is no upper end to be doubled."""
    spreads = lasting.twice_high_from / lasting.contact_spread
    assert 0.1 < spreads < 2.0
    assert lasting.effect.high > 0.5  # above 100 %, per cent are whole
    twice = f"{200 * lasting.effect.high:.0f} %"
    words = f"and more than {twice} if it fades within {spreads:.2g} times the spread"
    assert words in lasting.sentence
    assert brief.twice_high_from is None
    assert "if it fades within" not in brief.sentence


def test_a_wider_margin_covers_faster_kinks():
    data = landings(strength=0.0, curvature=0.0)
    found = [
        judge(
            data.before, data.after, data.instants, seed=1, flips=99, margin=margin
        ).holds_from
        for margin in (0.2, 0.4)
    ]
    assert found[1] < found[0]


@pytest.mark.parametrize(
    ("feet", "at_contact", "saturates"),
    [(3, 0.9, True), (3, 0.3, False), (4, 0.55, False), (4, 1.5, True)],
)
def test_only_kinks_that_are_larger_at_the_contact_saturate(
    monkeypatch, brief, feet, at_contact, saturates
):
    """Smaller ones grow with the delay; `low` would lie above their estimate.

    Of four feet, they are larger than the interval over the landings.
    """
    over = brief.effect_over_landings
    slow = replace(over, estimate=at_contact * over.estimate / 0.5)
    fit = SimpleNamespace(
        scores=np.eye(50),
        allowed=0.1,
        at_contact=lambda _: (slow,),
        with_slopes=lambda slopes: slopes,
    )
    monkeypatch.setattr(effect, "saturation", lambda *_, **__: (0.001, slow))
    feet_of = SimpleNamespace(expected=np.zeros((50, feet)))
    rng = np.random.default_rng(1)
    found = effect.at_the_contact(
        fit, feet_of, over, lambda size: size, generator=rng, flips=99
    )
    assert found.saturates == saturates
    assert (found.size == over) == (not saturates)
    assert found.size.low <= found.size.estimate
    if saturates:
        assert found.size.estimate == slow.estimate
        assert not found.size.is_bounded


@pytest.mark.parametrize(("feet", "within"), [(3, 0.4), (4, 0.6)])
@pytest.mark.parametrize("jump", [0.0, 1.2])
def test_a_jump_is_named_only_if_no_fading_bend_explains_it(feet, within, jump):
    data = fading_one_side(within=within, jump=jump, feet=feet)
    found = judge(data.before, data.after, data.instants, seed=3, flips=199)
    is_unsure = "maps.jump_unsure" in [note.code for note in found.notes]
    rows = [row["low"] for row in found.orders if row["of"] == "jump"]
    assert found.saturates
    assert found.jump.estimate > found.jump.allowed
    assert (found.jump.low > 0.0) == (jump > 0.0)
    assert any(low > 0.0 for low in rows) == (jump > 0.0)
    assert ("the outcome jumps by" in found.sentence) == (jump > 0.0)
    assert ("jumps most" in found.main_contrast) == (jump > 0.0)
    assert is_unsure == (jump == 0.0)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_jump_that_a_sharp_bend_explains_as_well_is_noted(seed):
    bend = smooth_steps(0.3, seed=seed)
    jump = landings(600, jump=1.0, feet=4, seed=seed)
    for data, may_be_a_bend in ((bend, True), (jump, False)):
        found = judge(data.before, data.after, data.instants, seed=3, flips=199)
        codes = [note.code for note in found.notes]
        assert found.jump.low > 0.0
        assert not found.saturates
        assert ("maps.jump_or_bend" in codes) == may_be_a_bend
