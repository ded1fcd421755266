"""The verdict's numbers agree with those that its page gives, step by step."""

from dataclasses import replace

import numpy as np
import pytest
from kinked_landings import (
    fading_one_side,
    landings,
    legs_and_feet,
    with_a_rare_order,
)
from verdict_by_hand import verdict

from hopdata.maps.verdict import judge

FLIPS = 199
N = 400


def _study(data, **more):
    study = {"x": data.before, "y": data.after, "instants": data.instants}
    return study | {"instants_se": np.zeros(data.instants.shape)} | more


def _of_legs():
    """Legs that scatter, feet that some landings hide, mistakes, and a low section."""
    data, feet = legs_and_feet(N, 1.0, 0.3)
    feet[::11, 1] = np.nan
    after = data.after.copy()
    after[:, 11::3] -= 0.25
    after[30:36, [0, 3, 6]] += 0.2  # slips
    errors = np.full(data.instants.shape, 4e-4)
    return _study(replace(data, after=after), feet=feet, instants_se=errors)


def _of_a_bend():
    """An effect that a foot has only while it is later than another, and that fades."""
    return _study(fading_one_side(n=600, strength=2.0))


def _of_a_jump_beside_bends():
    """The same, and a jump."""
    return _study(fading_one_side(n=600, strength=2.0, jump=1.2))


def _of_a_session():
    """Landings on two surfaces by turns."""
    data = landings(n=N, strength=0.3)
    surface = np.arange(N) // 50 % 2
    after = data.after.copy()
    after[:, 9:] *= (1 + 0.3 * surface)[:, None]
    return _study(replace(data, after=after), blocks=surface)


def _of_slow_change():
    """Landings that err alike, but within what chance explains."""
    data = landings(n=500, strength=0.3)
    after = data.after.copy()
    after[:, 9:] *= (1 + 0.3 * np.arange(500) / 500)[:, None]
    return _study(replace(data, after=after))


STUDIES = {
    "kinks": lambda: _study(landings(n=N, strength=0.3)),
    "jumps": lambda: _study(landings(n=N, strength=0.3, jump=0.4)),
    "two feet": lambda: _study(landings(n=N, strength=0.3, feet=2)),
    "four feet": lambda: _study(landings(n=N, strength=0.3, feet=4)),
    "feet together": lambda: _study(landings(n=N, jump=0.4, feet=4, parallel=True)),
    "saturation": lambda: _study(landings(n=900, strength=1.0, spent_within=0.2)),
    "a bend like a jump": _of_a_bend,
    "a jump beside bends": _of_a_jump_beside_bends,
    "legs and feet": _of_legs,
    "session": _of_a_session,
    "slow change": _of_slow_change,
    "jumps alone": lambda: _study(landings(n=N, jump=0.4)),
    "rare order": lambda: _study(with_a_rare_order()),
}


# What makes a study a test of a step of the page.
SHOWS = {
    "jumps": lambda answer: answer.jump.low > 0,
    "feet together": lambda answer: any("," in row["first"] for row in answer.orders),
    "saturation": lambda answer: answer.saturates,
    "a bend like a jump": lambda answer: (
        answer.jump.low == 0
        and any(note.code == "maps.jump_unsure" for note in answer.notes)
    ),
    "a jump beside bends": lambda answer: (
        answer.jump.low > 0 and answer.saturation_p_value < 0.01
    ),
    "legs and feet": lambda answer: (
        answer.posture == "inputs of the map"
        and len(answer.gross_errors["outcome_far_off"]) > 0
        and answer.effect.allowed > 0.2
    ),
    "session": lambda answer: "block" in answer.session,
    "slow change": lambda answer: "time" in answer.session,
    "jumps alone": lambda answer: answer.decided_by == "jump",
    "rare order": lambda answer: answer.n_landings > 350,
}


def _flat(value, name=""):
    """Return numbers and words by name."""
    if isinstance(value, dict):
        parts = value.items()
    elif isinstance(value, list):
        parts = enumerate(value)
    else:
        return {name: value}
    found = {}
    for key, part in parts:
        found |= _flat(part, f"{name}.{key}")
    return found


def _different(by_hand, answer):
    """Return the names of what does not agree to 1e-6, and how many numbers there are."""
    every = answer.to_dict()
    every["levels"] = list(every["levels"].values())
    given = _flat(every)
    found = _flat(by_hand)
    wrong = []
    for name, value in found.items():
        if value is None or isinstance(value, str):
            agrees = given[name] == value
        else:
            agrees = given[name] == pytest.approx(value, rel=0, abs=1e-6)
        if not agrees:
            wrong.append(name)
    return wrong, len(found)


@pytest.mark.parametrize("name", STUDIES)
def test_each_number_agrees_with_that_computed_from_the_page(name):
    study = STUDIES[name]()
    by_hand = verdict(**study, seed=3, flips=FLIPS)
    answer = judge(**study, seed=3, flips=FLIPS)
    wrong, count = _different(by_hand, answer)
    assert wrong == []
    assert count > 40
    if name in SHOWS:
        assert SHOWS[name](answer)


def test_another_seed_does_not_agree():
    study = STUDIES["jumps"]()
    by_hand = verdict(**study, seed=4, flips=FLIPS)
    wrong, _ = _different(by_hand, judge(**study, seed=3, flips=FLIPS))
    assert ".effect_over_landings.high" in wrong
    assert ".jump.high" in wrong
    assert ".effect_over_landings.estimate" not in wrong  # needs no random signs


def test_other_outcomes_do_not_agree():
    study = STUDIES["kinks"]()
    by_hand = verdict(**study, seed=3, flips=FLIPS)
    study["y"] = study["y"].copy()
    study["y"][7] = study["y"][8]
    wrong, _ = _different(by_hand, judge(**study, seed=3, flips=FLIPS))
    assert ".effect_over_landings.estimate" in wrong
