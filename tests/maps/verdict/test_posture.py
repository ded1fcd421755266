"""Feet before the landing, and noise of the state, in the verdict."""

from dataclasses import replace

import numpy as np
import pytest
from kinked_landings import landings, legs_and_feet, marker_states

from hopdata.errors import ConfigError
from hopdata.maps.verdict import judge

OPTIONS = {"seed": 3, "flips": 199}


def _judged(data, feet=None, **options):
    errors = np.full(data.instants.shape, 4e-4)
    return judge(
        data.before,
        data.after,
        data.instants,
        instants_se=errors,
        feet=feet,
        **(OPTIONS | options),
    )


@pytest.fixture(scope="module")
def scattered():
    """Legs that scatter as much as the contacts, with and without a kink."""
    return {strength: legs_and_feet(700, 1.0, strength) for strength in (0.0, 0.3)}


def test_feet_before_the_landing_foretell_what_the_state_does_not(scattered):
    data, feet = scattered[0.3]
    steady, _ = legs_and_feet(700, 0.0, 0.3)
    # The kinks are the same, and the instants that they follow vary more.
    varies = np.std(data.instants) / np.std(steady.instants)
    wanted = varies * _judged(steady).effect.estimate
    blind = _judged(data)
    seeing = _judged(data, feet)
    assert blind.contacts_r2 < 0.6 < 0.99 < seeing.contacts_r2
    assert seeing.conclusion == "different"
    assert seeing.effect.estimate == pytest.approx(wanted, rel=0.15)
    assert blind.conclusion == "cannot tell"
    assert blind.effect.upper_bound > wanted
    codes = [note.code for note in seeing.notes]
    assert "maps.feet_used" in codes
    assert "maps.not_foretold" in [note.code for note in blind.notes]
    assert seeing.posture == "inputs of the map"


def test_scattering_legs_of_a_smooth_map_are_no_difference(scattered):
    data, feet = scattered[0.0]
    seeing = _judged(data, feet)
    assert seeing.conclusion == "no difference"
    assert _judged(data).conclusion != "different"


def test_feet_that_the_state_foretells_change_nothing():
    data, feet = legs_and_feet(500, 0.0, 0.3)
    assert _judged(data, feet).effect == _judged(data).effect
    assert _judged(data, feet).posture == "foretold by the state of the body"


@pytest.mark.parametrize(("share", "used"), [(0.1, True), (0.4, False)])
def test_landings_without_feet_are_left_out_or_feet_are_not_used(
    scattered, share, used
):
    data, feet = scattered[0.3]
    feet = feet.copy()
    hidden = round(share * len(feet))
    feet[:hidden, 1] = np.nan
    answer = _judged(data, feet)
    assert (answer.posture == "inputs of the map") == used
    assert answer.n_landings == len(feet) - hidden * used
    codes = [note.code for note in answer.notes]
    assert ("maps.feet_hidden" in codes) == used


def test_noise_of_the_state_hides_no_difference():
    """Without the allowance for it, half of the kinks would be missing."""
    data = landings(n=900, strength=0.3, noise=0.02)
    true = _judged(data).effect.estimate
    rng = np.random.default_rng(2)
    noise = np.repeat([0.001, 0.02], 9)
    seen = replace(
        data, before=data.before + noise * rng.standard_normal(data.before.shape)
    )
    found = _judged(seen)
    assert found.contacts_r2 < 0.99
    assert found.effect.upper_bound > true
    assert found.effect.allowed > _judged(data).effect.allowed


def test_shapes_of_feet_and_session_are_checked(scattered):
    data, feet = scattered[0.0]
    with pytest.raises(ConfigError, match="feet: expected a position"):
        _judged(data, feet[:, :2])
    with pytest.raises(ConfigError, match="time: expected an instant"):
        _judged(data, time=np.arange(3.0))
    negative = np.ones_like(feet)
    negative[:3, 0] = -1.0
    gone = np.where(np.arange(len(feet)) < 3, np.nan, 1.0)
    with pytest.raises(ConfigError, match="found 3 that are not finite"):
        _judged(data, time=gone)
    with pytest.raises(ConfigError, match="feet_se: expected nothing without feet"):
        _judged(data, feet_se=np.ones_like(feet))
    with pytest.raises(ConfigError, match=r"feet_se: .* found 9 below zero"):
        _judged(data, feet, feet_se=negative)
    with pytest.raises(ConfigError, match="blocks: expected a label"):
        _judged(data, blocks=["a", "b"])


def test_a_changing_session_is_fitted_and_said():
    data = landings(n=700, noise=0.02)
    n = len(data.x)
    block = np.repeat(["grass", "sand"], [n // 2, n - n // 2])
    softer = 1.0 + 0.3 * (block == "sand")[:, None]
    before, after = marker_states(data.x, data.y * softer, np.random.default_rng(1))
    seen = replace(data, before=before, after=after)
    blind = _judged(seen, time=np.zeros(n))
    told = _judged(seen, time=np.zeros(n), blocks=block)
    assert told.session == ("block",)
    assert blind.session == ()
    assert told.effect.upper_bound < 0.7 * blind.effect.upper_bound
    assert "maps.session" in [note.code for note in told.notes]
