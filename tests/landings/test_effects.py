"""What filters, resampling and soft tissue do, against recordings without them."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping
from scipy.signal import butter, filtfilt

from hopdata import Recording
from hopdata.landings.effects import (
    Methods,
    effects,
    find_contacts_and_states,
    find_in_study,
    moved_contacts,
    moved_states,
    study_effects,
)
from hopdata.recordings.quality.restoring import filter_of, recorded, unfiltered

# Seeds that were not looked at when anything was chosen.
SEEDS = (21, 22, 23)

# How far a stated effect may be from the true one.
FACTOR = 1.5


def clean(seed, *, n_frames=1100):
    time, positions = hopping(seed, n_frames=n_frames)
    return Recording.from_arrays(
        time, positions, MARKERS, feet=MARKERS[3:6], body=MARKERS[:3]
    )


def filtered(recording, hz, poles=2):
    cut = 2 * hz / recording.rate_hz
    smooth = filtfilt(*butter(poles, cut), recording.positions, axis=0)
    # Files have single precision.
    return replace(recording, positions=smooth.astype(np.float32).astype(float))


def resampled(recording, rate_hz, kind="linear"):
    from scipy.interpolate import interp1d

    time = np.arange(0.0, recording.time[-1] - 1 / rate_hz, 1 / rate_hz)
    moved = interp1d(recording.time, recording.positions, axis=0, kind=kind)(time)
    return replace(recording, time=time, positions=np.round(moved, 6), rate_hz=rate_hz)


def wobbling(recording, amplitude_m, seed, *, hz=15.0, decay_s=0.05):
    """Let body markers swing after each first contact."""
    rng = np.random.default_rng(seed)
    first_s = np.nanmin(find_contacts_and_states(recording).instants, axis=1)
    positions = recording.positions.copy()
    for begin_s in first_s[np.isfinite(first_s)]:
        since = recording.time - begin_s
        swings = (since > 0) & (since < 0.4)
        wave = np.sin(2 * np.pi * hz * since) * np.exp(-since / decay_s)
        for marker in range(3):
            way = rng.normal(0, amplitude_m, 3)
            positions[swings, marker] += wave[swings, None] * way
    return replace(recording, positions=positions)


def true_effect(given, original):
    """Return what was done to a recording, by the recording as it was before."""
    # At the sections that a study of the given recording has.
    after = find_contacts_and_states(given)
    before = find_contacts_and_states(original, after.sections)
    moved, _ = moved_contacts(after, before, time_scale=given.time_scale)
    true = {"common_ms": 1e3 * np.median(moved), "spread_ms": 1e3 * np.std(moved)}
    return true | moved_states(after, before, time_scale=given.time_scale)


def within_factor(stated, true):
    return true / FACTOR <= stated <= true * FACTOR


@pytest.mark.parametrize("seed", SEEDS)
def test_a_recording_that_nobody_processed_says_nothing(seed):
    assert effects(clean(seed)) == []


@pytest.mark.parametrize(("hz", "seed"), [(8, 21), (12, 22)])
def test_a_filter_is_told_in_ms_and_mm(hz, seed):
    original = clean(seed)
    given = filtered(original, hz)
    (message,) = effects(given)
    assert message.code == "landings.filter_moves"
    stated = message.values
    true = true_effect(given, original)
    assert within_factor(stated["spread_ms"], true["spread_ms"])
    # What all contacts share hangs on how soft contacts are taken to be, too.
    shared = stated["common_ms"]
    assert (
        within_factor(shared, true["common_ms"])
        or abs(shared - true["common_ms"]) < 3.0
    )
    for side in ("pre", "post"):
        assert within_factor(stated[f"{side}_mm"], true[f"{side}_mm"])
    assert stated["half_period_ms"] == pytest.approx(500 / hz, rel=0.15)
    assert f"{stated['spread_ms']:.1f} ms" in str(message)


@pytest.mark.parametrize(("kind", "seed"), [("linear", 21), ("cubic", 23)])
def test_resampling_is_undone_and_told_in_ms_and_mm(seed, kind):
    original = clean(seed)
    given = resampled(original, 120.0, kind)
    back = recorded(given)
    assert back.rate_hz == pytest.approx(100.0)
    n_frames = len(back.time)
    inside = slice(5, n_frames - 5)
    same = original.positions[:n_frames][inside]
    np.testing.assert_allclose(back.positions[inside], same, atol=3e-5)
    (message,) = effects(given)
    stated = message.values
    true = true_effect(given, original)
    assert message.code == "landings.resampling_moves"
    assert stated["from_hz"] == pytest.approx(100.0)
    if kind == "linear":
        assert stated["common_ms"] < -1.0  # contacts come early
    for key in ("spread_ms", "pre_mm", "post_mm", "post_m_s"):
        assert within_factor(stated[key], true[key])
    assert stated["common_ms"] == pytest.approx(true["common_ms"], rel=0.1, abs=0.1)


@pytest.mark.parametrize("seed", SEEDS[2:])
def test_markers_that_wobble_are_told_with_what_that_does_to_the_state(seed):
    original = clean(seed)
    given = wobbling(original, 0.005, seed)
    (message,) = effects(given)
    assert message.code == "landings.wobble_moves"
    stated = message.values
    assert within_factor(stated["post_mm"], true_effect(given, original)["post_mm"])
    # Noise of a coordinate, and what a swing of 5 mm that decays is on average.
    assert stated["flight_mm"] == pytest.approx(0.6, rel=0.1)
    assert within_factor(stated["wobble_mm"], 1.9)


def test_a_filter_is_undone_as_far_as_the_digits_go():
    original = clean(24)
    given = filtered(original, 12)
    back = unfiltered(given.positions, filter_of(given.body))

    def off(positions):
        return np.sqrt(np.mean((positions - original.positions)[20:-20] ** 2))

    # Of the noise half the band comes back; the kinks of the feet come back whole.
    assert off(back) < 0.75 * off(given.positions)
    assert filter_of(original.body) is None
    assert recorded(original) is None


def test_a_recording_with_few_landings_is_told_of_its_contacts_alone():
    original = clean(25, n_frames=1100)
    given = filtered(original, 12)
    short = given.part(slice(0, 700))
    found = find_contacts_and_states(short.part(slice(0, 110)))
    assert found.pairs is None
    assert len(effects(short)) == 1


def test_the_recordings_of_a_study_are_compared_with_one_law():
    first, second = (
        replace(filtered(clean(seed, n_frames=700), 12), name=name)
        for seed, name in ((26, "one"), (27, "two"))
    )
    untouched = replace(clean(28, n_frames=700), name="three")
    study = [first, second, untouched]
    told = study_effects(study)
    assert [len(messages) for messages in told] == [1, 1, 0]
    after = find_in_study(study, Methods())
    original = [
        replace(one, positions=unfiltered(one.positions, filter_of(one.body)))
        for one in (first, second)
    ]
    before = find_in_study([*original, untouched], Methods(), after[0].sections)
    for k in range(2):
        moved, _ = moved_contacts(after[k], before[k], time_scale=study[k].time_scale)
        stated = told[k][0].values
        assert stated["common_ms"] == 1e3 * np.median(moved)
    # Alone it has less to learn from.
    (alone,) = effects(first)
    assert alone.values != told[0][0].values


def test_effects_are_those_on_the_methods_of_the_study():
    given = filtered(clean(29, n_frames=700), 12)
    (by_default,) = effects(given)
    sections = find_contacts_and_states(given).sections
    higher = {
        "pre_height_m": sections.pre_height_m + 0.03,
        "post_height_m": sections.post_height_m,
    }
    (at_others,) = effects(given, Methods(sections=higher))
    for key in ("common_ms", "spread_ms"):
        assert at_others.values[key] == by_default.values[key]
    assert at_others.values["pre_mm"] != by_default.values["pre_mm"]
    (printed,) = effects(given, Methods(contacts={"method": "velocity_minimum"}))
    assert printed.values["common_ms"] != by_default.values["common_ms"]
