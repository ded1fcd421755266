"""The verdict on maps whose derivative is known to be one, or to differ by a known amount."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from kinked_landings import landings

from hopdata.maps.verdict import judge
from hopdata.maps.verdict.significance import KinkTest

OPTIONS = {"seed": 3, "time_unit_s": 0.05, "flips": 499}


def verdict(data, **options):
    return judge(data.before, data.after, data.instants, **(OPTIONS | options))


def test_one_curved_map_for_all_orders_is_no_difference():
    answer = verdict(landings())
    assert answer.conclusion == "no difference"
    assert answer.test.p_value > 0.05
    assert answer.effect.upper_bound < 0.2
    assert f"{answer.effect.upper_bound:.2g}" in answer.sentence


def test_a_map_with_kinks_is_different_and_the_interval_holds_its_size():
    data = landings(strength=0.3)
    answer = verdict(data)
    assert answer.conclusion == "different"
    assert answer.test.p_value == 1 / (1 + OPTIONS["flips"])
    exact = verdict(landings(n=5000, strength=0.3, noise=1e-3, seed=8))
    assert answer.effect.low < exact.effect.estimate < answer.effect.high


def test_no_p_value_stands_beside_the_one_that_decides():
    said = json.dumps(verdict(landings()).to_dict())
    assert said.count("p_value") == 1
    assert not {"specialised", "subspaces", "separate"} & {*json.loads(said)}


def test_size_of_the_effect_grows_in_proportion_to_the_kinks():
    sizes = [verdict(landings(strength=s, noise=1e-3)).effect.estimate for s in (0.1, 0.2)]
    assert sizes[1] / sizes[0] == pytest.approx(2.0, rel=0.1)


def test_every_window_finds_the_same_size():
    """Each sees the kinks in combinations of its own; the size does not depend on these."""
    answer = verdict(landings(n=3000, strength=0.3, noise=1e-3))
    found = [window.kinks for window in answer.windows]
    assert len(found) == 5
    assert np.allclose(found, answer.effect.estimate, rtol=0.1)


@pytest.mark.parametrize("apart_s", [0.0, 2e-5])
def test_two_feet_that_always_land_together_are_no_error(apart_s):
    data = landings(strength=0.3)
    instants = data.instants.copy()
    rng = np.random.default_rng(4)
    instants[:, 1] = instants[:, 0] + apart_s * rng.standard_normal(len(instants))
    answer = verdict(replace(data, instants=instants))
    assert answer.sentence
    if answer.effect is not None:
        assert answer.effect.low <= answer.effect.estimate <= answer.effect.high


def test_the_interval_begins_at_zero_where_the_test_finds_nothing(monkeypatch):
    data = landings(strength=0.3)
    assert verdict(data).effect.low > 0
    unsure = KinkTest(statistic=50.0, degrees_of_freedom=44, p_value=0.06, flips=99)
    module = sys.modules["hopdata.maps.verdict.judge"]  # the package shows a function of that name
    monkeypatch.setattr(module, "flip_signs", lambda *_, **__: unsure)
    answer = verdict(data)
    assert answer.conclusion != "different"
    assert answer.effect.low == 0.0
    assert next(window for window in answer.windows if window.chosen).kinks_low == 0.0


def test_noise_that_hides_the_kinks_leaves_the_data_unable_to_tell():
    answer = verdict(landings(n=450, noise=3.0))
    assert answer.conclusion == "cannot tell"
    assert answer.effect.detectable > 0.2
    assert "cannot tell" in answer.sentence


@pytest.mark.parametrize("n", [1, 2, 4, 9, 10, 11, 12, 15, 100])
def test_too_few_landings_are_said_to_be_too_few(n):
    answer = verdict(landings(n=n))
    assert answer.conclusion == "cannot tell"
    assert answer.effect is None
    assert answer.notes[-1]["what"] == "verdict"


def test_one_schedule_alone_cannot_tell():
    data = landings()
    one = np.flatnonzero((np.diff(data.instants, axis=1) > 0.004).all(axis=1))
    data = replace(
        data, before=data.before[one], after=data.after[one], instants=data.instants[one]
    )
    assert verdict(data).conclusion == "cannot tell"


def test_two_markers_are_no_rigid_body():
    data = landings(n=300)
    two = np.r_[0:6, 9:15]
    answer = verdict(replace(data, before=data.before[:, two], after=data.after[:, two]))
    assert answer.conclusion == "cannot tell"
    assert "3 body markers" in answer.sentence


def test_landings_without_an_instant_are_counted_and_left_out():
    data = landings()
    data.instants[:7, 1] = np.nan
    answer = verdict(data)
    assert answer.n_landings == 893
    assert "7 of 900" in answer.notes[0]["reason"]


def test_where_and_which_way_a_landing_was_does_not_matter():
    data = landings(n=600, strength=0.2)
    moved = replace(data, before=_moved(data.before), after=_moved(data.after))
    a, b = verdict(data).effect, verdict(moved).effect
    assert a.estimate == pytest.approx(b.estimate, rel=1e-3)


def _moved(states):
    angle, c, s = 0.3, np.cos(0.3), np.sin(0.3)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    turned = np.einsum("ij,nbj->nbi", turn, states.reshape(len(states), -1, 3))
    turned[:, :3, :2] += [3.0, angle]
    return turned.reshape(len(states), -1)


@pytest.mark.parametrize("feet", [2, 4])
def test_other_numbers_of_feet(feet):
    one, many = (landings(n=1200, feet=feet, strength=s) for s in (0.0, 0.5))
    assert verdict(one, confidence=0.99).conclusion == "no difference"
    assert verdict(many, confidence=0.99).conclusion == "different"


def test_same_seed_same_answer_and_it_fits_into_json():
    data = landings(n=500)
    one, two = (json.dumps(verdict(data).to_dict(), allow_nan=False) for _ in range(2))
    assert one == two
    assert len(verdict(data).windows_table()) == len(json.loads(one)["windows"])
