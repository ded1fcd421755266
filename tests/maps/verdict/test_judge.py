"""The verdict on maps whose derivative is unique, or differs by a known amount."""

import json
import os
import tracemalloc
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from kinked_landings import landings

from hopdata.errors import AnalysisError, ConfigError
from hopdata.maps.verdict import judge
from hopdata.maps.verdict.effect import EffectSize
from hopdata.maps.verdict.inputs import two_kinds
from hopdata.maps.verdict.judge import conclude
from hopdata.maps.verdict.limits import (
    ERRORS_UNKNOWN_CODE,
    NOT_FORETOLD_CODE,
    TWO_KINDS_CODE,
)
from hopdata.maps.verdict.model import LEFT
from hopdata.maps.verdict.words import (
    CANNOT_TELL,
    DIFFERENT,
    outlook,
    sentence,
    with_no_more,
)
from hopdata.messages import Message

OPTIONS = {"seed": 3, "flips": 199}
SEEDS = range(1, 6 if "ALL" in os.environ else 3)


def verdict(data, **options):
    return judge(data.before, data.after, data.instants, **(OPTIONS | options))


def some(data, rows):
    names = ("before", "after", "instants", "x", "y")
    return replace(data, **{name: getattr(data, name)[rows] for name in names})


def test_one_curved_map_for_all_orders_is_no_difference():
    answer = verdict(landings())
    assert answer.conclusion == "no difference"
    assert answer.effect.low == 0.0
    assert answer.effect.upper_bound < 0.2
    assert (
        f"{float(f'{100 * answer.effect.upper_bound:.2g}'):g} % of" in answer.sentence
    )


def test_a_map_with_kinks_is_different_and_the_interval_holds_its_size():
    answer = verdict(landings(strength=0.3))
    assert answer.conclusion == "different"
    assert answer.effect.p_value == 1 / (1 + OPTIONS["flips"])
    exact = verdict(landings(n=2000, strength=0.3, noise=1e-3, seed=8))
    assert answer.effect.low < exact.effect.estimate < answer.effect.high


@cache
def exact_jump(strength):
    """Return the jump that many landings almost without noise have."""
    data = landings(n=2000, strength=strength, jump=0.4, noise=1e-3, seed=8)
    return verdict(data).jump.estimate


#: Each seed with one strength, or with `ALL=1` each with both.
JUMPS = [*zip(SEEDS, (0.0, 0.3), strict=False)]
if "ALL" in os.environ:
    JUMPS = [(seed, strength) for seed in SEEDS for strength in (0.0, 0.3)]


@pytest.mark.parametrize(("seed", "strength"), JUMPS)
def test_a_jump_of_the_outcome_is_a_difference_beside_kinks_or_without(seed, strength):
    none = verdict(landings(strength=strength, seed=seed))
    assert none.jump.low == 0.0
    assert "jumps" not in none.sentence
    one = verdict(landings(strength=strength, seed=seed, jump=0.4))
    assert one.conclusion == "different"
    assert "the outcome jumps by " in one.sentence
    assert one.jump.low < exact_jump(strength) < one.jump.high


@pytest.mark.parametrize("seed", SEEDS[:2])
def test_a_jump_does_not_widen_what_is_known_of_the_kinks(seed):
    """Left in their residuals, it made the detectable size 1.6 to 1.8 times as large."""
    none = verdict(landings(seed=seed))
    beside = verdict(landings(seed=seed, jump=0.4))
    assert beside.jump.low > 0.0
    assert beside.effect.low == 0.0
    assert beside.effect.detectable < 1.5 * none.effect.detectable


def test_noise_of_the_states_does_not_shrink_a_jump():
    """The outcome then varies by half as much again, and the map does not."""
    exact = verdict(landings(n=2000, jump=0.4, seed=5))
    noisy = verdict(landings(n=2000, jump=0.4, noise=3.0, seed=5))
    assert noisy.jump.estimate == pytest.approx(exact.jump.estimate, rel=0.25)
    assert noisy.jump.upper_bound > exact.jump.estimate


@pytest.mark.parametrize("seed", SEEDS)
def test_a_session_exported_twice_cannot_tell(seed):
    data, generator = landings(n=400, seed=seed), np.random.default_rng(seed)
    twice = some(data, np.r_[:400, :400])
    error = 1e-3 * data.before.std(axis=0)
    again = verdict(
        replace(twice, before=twice.before + error * generator.normal(size=(800, 1)))
    )
    assert "400 of 800 touchdowns are copies" in again.sentence
    assert "1 of 401 touchdowns" in verdict(some(data, np.r_[:400, 7])).sentence
    assert verdict(data).effect is not None


def test_blurred_states_cannot_tell():
    answer = verdict(landings(strength=0.3), blurred="they are smoothed")
    assert answer.sentence == "These data cannot tell: they are smoothed."
    assert answer.effect is None


def test_the_answer_is_said_to_follow_from_the_jump_where_that_is_all():
    assert verdict(landings(jump=0.4)).decided_by == "jump"
    one = verdict(landings(strength=0.3, jump=0.1))
    assert one.decided_by == "effect"
    assert (" And where two feet " in one.sentence) == (one.jump.low > 0.0)


def test_size_of_the_effect_grows_in_proportion_to_the_kinks():
    sizes = [
        verdict(landings(strength=s, noise=1e-3)).effect.estimate for s in (0.1, 0.2)
    ]
    assert sizes[1] / sizes[0] == pytest.approx(2.0, rel=0.1)


def _moved(change, seed=1):
    """Return the verdict on a C1 map to which `change` of the instants (spreads) adds."""
    data = landings(600, seed=seed, curvature=0.0)
    moved = 0.01 * change(data.instants / 0.01)[:, None]
    after = data.after.copy()
    after[:, 0:9:3] += moved
    after[:, 9::3] += 20.0 * moved
    return judge(data.before, after, data.instants, seed=1, flips=199)


def _bend(width):
    """Return |t_1 - t_2|, rounded over a width in contact spreads."""
    return lambda t: width * np.log(np.cosh((t[:, 0] - t[:, 1]) / width))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_bend_within_the_spread_looks_like_a_kink_and_a_wider_one_does_not(seed):
    assert _moved(_bend(0.5), seed).conclusion == "different"
    assert _moved(_bend(2.0), seed).conclusion != "different"


def test_what_grows_with_the_square_of_the_delay_looks_like_a_kink():
    """Its derivative at the simultaneous contact is zero, which the page admits."""

    def grown(t):
        return 0.6 * (t.max(axis=1) - t.min(axis=1)) ** 2

    def smooth(t):
        return 0.6 * (t[:, 0] - t[:, 1]) ** 2

    assert _moved(grown).effect.low > 0.0
    assert _moved(smooth).effect.low == 0.0


@pytest.mark.parametrize("feet", [2, 3])
@pytest.mark.parametrize("n", [450, 900])
def test_third_order_terms_along_the_contacts_widen_what_is_no_evidence(feet, n):
    """The allowance goes with their power of 1.5 for any number of landings; upper ends follow."""
    near, far, farther = (
        verdict(landings(n=n, feet=feet, cubic=c)) for c in (0.0, 0.2, 0.4)
    )
    # The instants' errors, which are not stated, round the kinks a little.
    assert near.effect.allowed == pytest.approx(LEFT, rel=0.06)
    assert near.effect.allowed >= LEFT
    assert near.notes == []
    allowed = [one.effect.allowed for one in (far, farther)]
    assert allowed[1] == pytest.approx(2**1.5 * allowed[0], rel=0.1)
    assert [note.what for note in far.notes] == ["contacts far apart"]
    assert f"{float(f'{100 * allowed[0]:.2g}'):g} %" in far.notes[0].reason
    wider = farther.effect.upper_bound - far.effect.upper_bound
    assert wider > 0.4 * (allowed[1] - allowed[0])
    assert farther.landings_needed is None


@pytest.mark.parametrize("of_these", [0.5, 0.2])
def test_landings_of_two_speeds_are_told(of_these):
    """They dilute a difference, which is relative to all variation, also between the two kinds."""
    one, two = (
        verdict(landings(strength=0.3, faster=f, of_these=of_these)) for f in (0.0, 8.0)
    )
    assert one.notes == []
    assert [(note.code, note.reason[:20]) for note in two.notes] == [
        (TWO_KINDS_CODE, "by their velocity be")
    ]
    assert two.effect.estimate < 0.85 * one.effect.estimate
    for seed in range(5):  # uniform values with a few outliers are of one kind
        inputs = np.random.default_rng(seed).uniform(-1, 1, (300, 8))
        inputs[:20, 4] += 30.0
        assert two_kinds(inputs - inputs.mean(axis=0)) == ""


def test_a_foot_and_its_copy_are_told():
    """A constant between their heights leaves one between their instants, plus the fits' errors."""
    data = landings(feet=3)
    error = (
        0.01
        * data.instants.std()
        * np.random.default_rng(1).standard_normal(len(data.instants))
    )
    copied = np.column_stack([data.instants, data.instants[:, 0] + 0.002 + error])
    one, two = verdict(data), verdict(replace(data, instants=copied))
    assert "always the same time apart" not in str(one.notes)
    assert "always the same time apart" in str(two.notes)


def test_the_answer_follows_from_the_interval_alone():
    """At the edge, no study is different with an interval from zero, or the reverse."""
    for seed in range(6):
        answer = verdict(
            landings(n=450, strength=0.07, noise=0.3, seed=seed), flips=199
        )
        assert (answer.conclusion == "different") == (answer.effect.low > 0)
        assert (answer.effect.p_value < 0.05) == (answer.effect.low > 0)
        assert answer.effect.low <= answer.effect.estimate <= answer.effect.high
        assert answer.effect.upper_bound <= answer.effect.high


def test_the_three_conclusions():
    assert conclude(0.0, 0.18, 0.2) == "no difference"
    assert conclude(0.0, 0.18, 0.17) == "cannot tell"
    assert conclude(0.01, 0.18, 0.2) == "different"


def test_what_could_have_been_seen_is_said():
    size = EffectSize(
        0.1, 0.0, 0.2, 0.18, 0.15, 0.3, 0.01, 0.01, 0.05, 0.1, 0.1, 0.15, 0.1
    )
    said = str(outlook(size, 2_312, 1_617, 0.8))
    assert "difference of 15 % would be found in 80 %" in said
    assert "you would need about 2,300 judged landings" in said
    assert "cannot be seen with any number" in str(outlook(size, None, 1_617, 0.8))
    none = replace(size, detectable=1.2)
    assert "Nothing could have been seen" in str(outlook(none, 144_000, 1_617, 0.8))


@pytest.mark.parametrize(
    ("landings", "enough"), [(989, False), (990, True), (1_617, True)]
)
def test_no_study_is_told_to_have_what_it_has(landings, enough):
    size = EffectSize(
        0.1, 0.0, 0.2, 0.18, 0.15, 0.3, 0.01, 0.01, 0.05, 0.1, 0.1, 0.15, 0.1
    )
    said = str(outlook(size, 990, landings, 0.8))
    assert ("you would need about 990 judged landings" in said) == (not enough)
    assert (
        "to see 20 %, about 990 of the judged landings are enough" in said
    ) == enough


def test_a_difference_that_was_found_counts_as_scatter():
    data = landings(400, strength=0.6)
    found = judge(data.before, data.after, data.instants, seed=1, flips=199)
    assert found.conclusion == "different"
    assert "Both numbers are upper limits" in found.outlook
    same = landings(400)
    alike = judge(same.before, same.after, same.instants, seed=1, flips=199)
    assert "upper limits" not in alike.outlook


@pytest.mark.parametrize(("jump", "is_wide"), [(0.34, True), (0.2, False)])
def test_a_jump_above_the_margin_that_is_not_excluded_is_told(jump, is_wide):
    sizes = (0.03, 0.0, 0.13, 0.12)
    said = sentence("no difference", sizes, "two orders", 0.95, 0.2)
    more = str(with_no_more(said, jump, None, margin=0.2))
    assert f"larger than {100 * jump:.0f} % of the map" in more
    assert ("which is more than the 20 % wanted" in more) == is_wide


# Arbitrary conventions do not change the answer.


def _scaled(data, length, time):
    units = np.repeat([length, length / time], data.before.shape[1] // 2)
    return replace(
        data,
        before=data.before * units,
        after=data.after * units,
        instants=data.instants * time,
    )


def _turned(data, angle):
    """Return the landings in home frames rotated by `angle` (n,), different for each landing."""
    c, s, zero, one = np.cos(angle), np.sin(angle), 0 * angle, 1 + 0 * angle
    turn = np.moveaxis(np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]]), 2, 0)

    def turned(states):
        return np.einsum(
            "nij,nbj->nbi", turn, states.reshape(len(states), -1, 3)
        ).reshape(len(states), -1)

    return replace(data, before=turned(data.before), after=turned(data.after))


def _markers(data, order):
    columns = np.arange(data.before.shape[1]).reshape(2, -1, 3)[:, order].ravel()
    return replace(data, before=data.before[:, columns], after=data.after[:, columns])


def _swapped_axes(data):
    """Return the landings with x forward turned into y to the left, still right-handed."""
    return _turned(data, np.full(len(data.before), np.pi / 2))


SAME = {
    "unit of time": lambda data: _scaled(data, 1.0, 1e3),
    "label of the frame rate": lambda data: _scaled(data, 1.0, 100.0 / 240.0),
    "unit of length": lambda data: _scaled(data, 1e3, 1.0),
    "units of both": lambda data: _scaled(data, 39.37, 1 / 60),
    "home marker": lambda data: _turned(
        data, 0.4 + 0.3 * np.cos(np.arange(len(data.before)))
    ),
    "axes of the plane": _swapped_axes,
    "order of the markers": lambda data: _markers(data, [2, 0, 1]),
    "order of the feet": lambda data: replace(
        data, instants=data.instants[:, [1, 2, 0]]
    ),
    "start of the clock": lambda data: replace(data, instants=data.instants - 0.25),
}


@pytest.fixture(scope="module", params=[0.0, 0.2])
def study(request):
    data = landings(n=600, strength=request.param, noise=0.1)
    return data, verdict(data)


@pytest.mark.parametrize("change", SAME)
def test_units_axes_and_names_change_nothing(study, change):
    data, before = study
    after = verdict(SAME[change](data))
    assert after.sentence == before.sentence
    for key, value in vars(before.effect).items():
        assert getattr(after.effect, key) == pytest.approx(
            value, rel=1e-9, abs=1e-12
        ), key


# Data that allow no answer give a sentence and no number.


def _one_order():
    data = landings(n=2400)
    return some(
        data, np.flatnonzero((np.diff(data.instants, axis=1) > 0.004).all(axis=1))
    )


def _marker_by_marker():
    """Return the position and velocity of each marker side by side."""
    data = landings(n=300)
    falling = np.r_[np.zeros(9), np.tile([0.0, 0.0, -1.2], 3)]
    columns = np.arange(18).reshape(2, 3, 3).transpose(1, 0, 2).ravel()
    return replace(data, before=(data.before + falling)[:, columns])


def _two_markers():
    data, two = landings(n=300), np.r_[0:6, 9:15]
    return replace(data, before=data.before[:, two], after=data.after[:, two])


def _constant():
    """Return a body that always falls in the same attitude."""
    data = landings(n=600)
    return replace(
        data, before=np.repeat(data.before[:1], 600, axis=0) + data.before[:, :1] * 0
    )


def _guessed():
    """Return contact instants that are unrelated to the landing."""
    data, rng = landings(n=900), np.random.default_rng(7)
    return replace(data, instants=0.01 * rng.standard_normal(data.instants.shape))


def _unknown():
    data = landings(n=300)
    return replace(data, before=np.full_like(data.before, np.nan))


def _one_frame():
    data = landings(n=600)
    return replace(data, instants=np.repeat(data.instants[:, :1], 3, axis=1))


def _still():
    """Return an outcome that is always the same."""
    data = landings(n=600)
    return replace(data, after=np.repeat(data.after[:1], 600, axis=0))


def _one_foot():
    data = landings(n=300)
    return replace(data, instants=data.instants[:, :1])


def _coarse():
    """Return contact instants rounded to more than the feet are apart, except for five landings."""
    data = landings(n=600)
    return replace(
        data, instants=np.where(np.arange(600)[:, None] < 5, data.instants, 1.0)
    )


def _again():
    """Return a recording that contains the same landings again, after a pause."""
    data = some(landings(n=300), np.r_[0:300, 0:40])
    rounding = 1e-12 * np.random.default_rng(2).standard_normal(data.before.shape)
    return replace(data, before=data.before + rounding, after=data.after - rounding)


BAD = {
    "no landing": (lambda: some(landings(n=10), np.arange(0)), "contacts, found 0."),
    "one landing": (lambda: landings(n=1), "contacts, found 1."),
    "one landing too few": (lambda: landings(n=149), "contacts, found 149."),
    "one landing too few, of two feet": (
        lambda: landings(n=138, feet=2),
        "at least 139 touchdowns with known states and contacts, found 138",
    ),
    "one schedule only": (
        _one_order,
        "two contact orders need 20 touchdowns each: 1 → 2 → 3 has 188",
    ),
    "two markers": (_two_markers, "3 body markers"),
    "marker by marker": (
        _marker_by_marker,
        "states: expected positions, then velocities",
    ),
    "all contacts in one frame": (_one_frame, "same instant"),
    "constant columns": (_constant, "do not vary"),
    "one constant coordinate": (
        lambda: landings(n=900, constant=0),
        "do not vary in all",
    ),
    "one constant velocity": (
        lambda: landings(n=900, constant=4),
        "do not vary in all",
    ),
    "instants of pure noise": (_guessed, "do not predict in which order"),
    "one foot": (_one_foot, "expected at least 2 feet, found 1"),
    "whole steps of time": (_coarse, "do not predict in which order"),
    "constant outcome": (_still, "an outcome of the landing does not vary"),
    "outcome equal to input": (
        lambda: replace(landings(), after=landings().before),
        "no noise at all",
    ),
    "NaN": (_unknown, "found 0"),
    "repeated rows": (lambda: some(landings(n=300), np.r_[0:300, 0:40]), "40 of 340"),
    "repeated but for rounding": (_again, "40 of 340"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_data_get_a_sentence_and_no_number(name):
    make, words = BAD[name]
    answer = verdict(make())
    assert answer.conclusion == "cannot tell"
    assert words in answer.sentence
    assert answer.effect is None
    assert answer.landings_needed is None
    assert answer.notes[-1].what == "verdict"


@pytest.mark.parametrize(
    "names", [["a", "b"], ["a", "b", "c", "d"], ["a", "a", "b"], "abc"]
)
def test_names_that_do_not_tell_the_feet_apart_are_refused(names):
    data = landings(100)
    arrays = (data.before, data.after, data.instants)
    with pytest.raises(
        ConfigError, match=r"^foot_names: expected 3 names, all different, found .*a"
    ):
        judge(*arrays, seed=1, foot_names=names)
    told = judge(*arrays, seed=1, foot_names=("toe", "heel", "thumb"))
    assert "toe" in told.contacts


def test_tables_of_unequal_length_are_refused():
    data = landings(n=300)
    with pytest.raises(
        AnalysisError, match=r"x, y, instants: .* found \(300, 18\), \(299, 18\)"
    ):
        judge(data.before, data.after[:-1], data.instants, **OPTIONS)


def test_landings_that_remember_those_before_are_noted_and_widen_the_interval():
    """States and errors both change slowly; the same landings in another order are not noted."""
    data, slow = landings(n=900), np.sin(np.arange(900) / 25.0)
    data = some(data, np.argsort(data.instants.std(axis=1)))
    data = replace(data, after=data.after + 0.02 * slow[:, None] * np.arange(18))
    mixed = some(data, np.random.default_rng(3).permutation(900))
    remembered, independent = verdict(data), verdict(mixed)
    what = "landings are not independent"
    (noted,) = [note for note in remembered.notes if note.what == what]
    assert "widens the interval" in noted.reason
    assert what not in [note.what for note in independent.notes]
    assert remembered.effect.squared_error > 3.0 * independent.effect.squared_error


def test_mistakes_are_left_out_and_told():
    data = landings()
    clean = verdict(data)
    assert not clean.notes
    data.after[[2, 499], -1] += 50.0
    answer = verdict(data)
    note = answer.notes[-1]
    assert note.what == "landings left out as far off"
    assert "2 of 900" in note.reason
    assert note.values["rows"] == answer.gross_errors == {"markers_apart": [3, 500]}
    assert answer.n_landings == 898
    assert answer.effect.upper_bound == pytest.approx(clean.effect.upper_bound, rel=0.1)


def test_rows_of_mistakes_are_those_of_the_arrays_given():
    data = landings()
    data.instants[10, 0] = np.nan
    data.after[[2, 499], -1] += 50.0
    answer = verdict(data)
    assert answer.gross_errors == {"markers_apart": [3, 500]}
    assert [note.code for note in answer.notes] == [
        "maps.left_out",
        "maps.gross_errors",
    ]


def test_of_too_few_landings_those_aside_are_told_if_there_are_any():
    data = landings(151)
    assert verdict(data).effect is not None
    data.after[[2, 99], -1] += 50.0
    found = verdict(data)
    assert found.effect is None
    assert "to fit a map, 2 far off all others aside: expected" in found.sentence
    assert found.sentence.endswith("found 149.")
    again = json.loads(json.dumps(found.to_dict()))
    assert str(Message.from_dict(again["messages"]["sentence"])) == found.sentence
    few = verdict(landings(100))
    assert "too few landings to fit a map: expected at least 150" in few.sentence


@pytest.mark.parametrize("apart_s", [0.0, 2e-5])
def test_two_feet_that_always_land_together_are_no_error(apart_s):
    data = landings(strength=0.3)
    instants = data.instants.copy()
    rng = np.random.default_rng(4)
    instants[:, 1] = instants[:, 0] + apart_s * rng.standard_normal(len(instants))
    answer = verdict(replace(data, instants=instants))
    assert answer.sentence


def test_noise_that_hides_the_kinks_leaves_the_data_unable_to_tell():
    answer = verdict(landings(n=450, noise=3.0))
    assert answer.conclusion == "cannot tell"
    assert answer.effect.detectable > 0.2
    assert "cannot tell" in answer.sentence


def test_landings_without_an_instant_are_counted_and_left_out():
    data = landings()
    data.instants[:6, 1] = np.nan
    data.before[6, 2] = np.inf
    answer = verdict(data)
    assert answer.n_landings == 893
    assert answer.notes[0].reason == (
        "in 7 of the 900 landings used, the state before or after, or the contact "
        "instant of a foot, is not known"
    )


@pytest.mark.parametrize(
    ("feet", "words"), [(2, "2 contact orders"), (4, "pairs of feet")]
)
def test_other_numbers_of_feet(feet, words):
    one, many = (landings(n=1200, feet=feet, strength=s) for s in (0.0, 0.5))
    assert verdict(one, confidence=0.99).conclusion == "no difference"
    answer = verdict(many, confidence=0.99)
    assert answer.conclusion == "different"
    assert words in answer.sentence


def test_same_seed_same_answer_and_it_fits_into_json():
    data = landings(n=500)
    one, two = (json.dumps(verdict(data).to_dict(), allow_nan=False) for _ in range(2))
    assert one == two


def test_memory_does_not_grow_with_the_square_of_the_landings():
    data = landings(n=4000)
    tracemalloc.start()
    verdict(data, flips=199)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4000**2 * 8 / 1.5


def test_a_bound_just_above_the_margin_is_not_rounded_to_it():
    said = str(sentence(CANNOT_TELL, (0, 0, 0, 0.2004), "two orders", 0.95, 0.2))
    assert "of up to 21 % of the map cannot be excluded, and 20 % was wanted" in said


def test_an_interval_is_rounded_outwards_and_its_estimate_to_nearest():
    said = str(sentence(DIFFERENT, (0.234, 0.118, 0.342, 0.4), "all", 0.95, 0.2))
    assert "23 %" in said
    assert "11 % to 35 %" in said


@pytest.mark.parametrize("seed", SEEDS)
def test_contacts_that_the_state_does_not_explain_are_noted(seed):
    data = landings(seed=seed)
    rigid = verdict(data)
    assert rigid.contacts_r2 > 0.995
    assert NOT_FORETOLD_CODE not in [note.code for note in rigid.notes]
    scatter_s = 0.0015  # of when each leg touches, beside what the body's state decides
    posture = np.random.default_rng(seed).normal(0.0, scatter_s, data.instants.shape)
    moved = replace(data, instants=data.instants + posture)
    answer = verdict(moved)
    varied = np.mean((data.instants - data.instants.mean(axis=1, keepdims=True)) ** 2)
    expected = varied / (varied + scatter_s**2 * (1 - 1 / 3))
    assert answer.contacts_r2 == pytest.approx(expected, abs=0.01)
    (note,) = [note for note in answer.notes if note.code == ERRORS_UNKNOWN_CODE]
    assert f"{100 * answer.contacts_r2:.1f} %" in note.reason
    # The same scatter as an error of measurement says nothing of the animal.
    known = verdict(moved, instants_se=np.full(data.instants.shape, scatter_s))
    assert known.contacts_r2 > 0.99
    assert NOT_FORETOLD_CODE not in [note.code for note in known.notes]


def test_standard_errors_have_the_shape_of_the_instants():
    data = landings(n=300)
    with pytest.raises(
        ConfigError, match=r"instants_se: expected a standard error .*\(300, 3\)"
    ):
        verdict(data, instants_se=np.zeros((300, 2)))


def test_words_are_messages_of_the_same_text():
    for data in (landings(strength=0.3), landings(), landings(n=40)):
        answer = verdict(data)
        content = json.loads(json.dumps(answer.to_dict()))
        for name, message in content["messages"].items():
            assert str(Message.from_dict(message)) == content[name]
        for note in content["notes"]:
            reason = Message.from_dict(note)
            assert str(reason) == note["reason"]
            assert reason.code.startswith("maps.")


def test_what_is_missing_has_a_code():
    data = landings()
    first = replace(data, instants=data.instants + np.array([0.0, 1.0, 2.0]))
    (note,) = verdict(first).notes
    assert note.code == "maps.too_few_orders"
    (note,) = verdict(data, blurred="they are smoothed").notes
    assert note.code == "maps.no_answer"
    assert note.values == {"reason": "they are smoothed"}
