"""Recordings that learn from one another: the levels study, recording and landing."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from falling_feet import falls
from jumps import KINDS, NAMES, PELVIS, make

from hopdata.landings.contacts.descents import LANDED
from hopdata.landings.contacts.find import find_landings, find_study_landings
from hopdata.landings.contacts.kink import FlightPriors, KinkFits
from hopdata.landings.contacts.kink_law import _own_stances, weak_priors
from hopdata.landings.contacts.law import FootHeights, Law, Trials, changed
from hopdata.landings.contacts.learning import learn, pooled_noises
from hopdata.landings.contacts.timing import Trial, find_all_contacts
from hopdata.landings.floor import fit_floor, level
from hopdata.recording import Recording


def found(every):
    """Time the contacts of several `falls` together; one `Contacts` for each."""
    trials = [
        Trial(made.time, made.heights, made.transitions, down_height_m=0.02)
        for made in every
    ]
    none = [None] * len(trials)
    return find_all_contacts(
        trials,
        gravity="learned",
        window_before_s=none,
        window_after_s=none,
        maximum_misfit=5.0,
    )


def errors(every, contacts):
    off = [
        one.instant - made.contacts for made, one in zip(every, contacts, strict=True)
    ]
    return np.concatenate(off)


@pytest.mark.parametrize("compliance_s", [0.0, 0.006])
def test_recordings_of_one_landing_learn_from_one_another(compliance_s):
    every = [falls(1, seed=s, compliance_s=compliance_s) for s in range(100, 116)]
    together = found(every)
    alone = [found([made])[0] for made in every]
    assert all((one.status == LANDED).all() for one in together)
    off = errors(every, together)
    se = np.concatenate([one.se for one in together])
    common = np.concatenate([one.common for one in together])
    rms = np.sqrt(np.mean(off**2))
    assert rms < 0.8 * np.sqrt(np.mean(errors(every, alone) ** 2))
    own = (off - off.mean()) / se
    assert 0.8 < np.sqrt(np.mean(own**2)) < 1.25
    assert abs(off.mean()) < 1.25 * common.max()
    # What one landing says alone is honest too.
    stated = np.concatenate([np.hypot(one.se, one.common) for one in alone])
    assert np.sqrt(np.mean((errors(every, alone) / stated) ** 2)) < 1.25


def test_a_recording_on_a_softer_floor_keeps_its_own_softness():
    hard = [falls(40, seed=s) for s in (1, 2)]
    soft = falls(40, seed=3, compliance_s=0.006)
    together = found([*hard, soft])
    off = errors([soft], together[2:])
    assert abs(off.mean()) < 1e-3
    alone = errors([soft], found([soft]))
    np.testing.assert_allclose(off, alone, atol=1e-3)
    assert abs(errors(hard, together[:2]).mean()) < 3e-4


def test_few_landings_in_other_shoes_keep_their_softness():
    quiet = {"noise_m": 2e-4}
    bare = [falls(n, seed=n, compliance_s=0.004, **quiet) for n in (3, 12)]
    shod = [falls(n, seed=n + 1, compliance_s=0.008, **quiet) for n in (3, 12)]
    together = found([*bare, *shod])
    stated = np.hypot(together[2].se, together[2].common)
    off = errors([shod[0]], [together[2]])
    assert abs(np.nanmean(off)) < 1e-3
    assert (np.abs(off) < 3 * stated).all()


def test_recordings_that_all_differ_from_what_suits_them_together_keep_their_own():
    """As where bare feet and shoes are equally many: nothing in between suits either."""
    laws = tuple(Law(weak_priors(3, "learned"), noise_m=3e-4) for _ in range(4))
    of_landing = np.repeat(np.arange(4), 10)
    trials = Trials((), of_landing)
    stances = [changed(laws, compliance_s=one_s) for one_s in (0.003, 0.005, 0.010)]
    suits = {0: 0, 1: 0, 2: 2, 3: 2}
    likelihoods = []
    for number in range(3):
        likes = [0.0 if suits[one] == number else -5.0 for one in of_landing]
        likelihoods.append(np.repeat(np.array(likes)[:, None], 3, axis=1))
    likelihoods[1] = np.full((40, 3), -3.0)
    found = _own_stances(trials, stances[1], likelihoods[1], stances, likelihoods)
    assert [law.compliance_s for law in found] == [0.003, 0.003, 0.010, 0.010]
    alike = [likelihoods[1], likelihoods[1] - 1.0, likelihoods[1] - 1.0]
    found = _own_stances(trials, stances[1], likelihoods[1], stances, alike)
    assert [law.compliance_s for law in found] == [0.005] * 4


def test_a_recording_in_which_no_law_holds_does_not_spoil_the_others():
    steady = [falls(40, seed=s) for s in (4, 5)]
    rough = falls(40, seed=6)
    since = rough.time.reshape(40, -1, 1) - rough.contacts[:, None]
    bump = 0.012 * np.exp(-0.5 * ((since + 0.03) / 0.008) ** 2)
    rough = replace(rough, heights=rough.heights + bump.reshape(-1, 3))
    with_it = errors(steady, found([*steady, rough])[:2])
    without = errors(steady, found(steady))
    np.testing.assert_array_equal(with_it, without)


def test_each_recording_has_its_own_noise():
    quiet = falls(30, seed=7, noise_m=2e-4)
    noisy = falls(30, seed=8, noise_m=1e-3)
    contacts = found([quiet, noisy])
    assert contacts[0].noise_m == pytest.approx(2e-4, rel=0.15)
    assert contacts[1].noise_m == pytest.approx(1e-3, rel=0.15)
    assert np.median(contacts[1].se) > 3 * np.median(contacts[0].se)


def fits_of(value, se, recording):
    """Return fits of two feet whose creep is known with an error, under a flat prior."""
    landings = len(value)
    flight = np.zeros((landings, 2, 4))
    unit_se = np.full((landings, 2, 4), np.inf)
    flight[:, 0, 3] = value
    unit_se[:, 0, 3] = se
    blank = np.zeros((landings, 2))
    counts = np.zeros((landings, 2), dtype=np.int64)
    dof = np.full((landings, 2), 20.0)
    return KinkFits(
        blank, blank, blank, blank, flight, unit_se, blank, blank, dof, counts, counts
    )


def creeps_learned(value, se, recording):
    """Return means and standard deviations of the creep in each recording."""
    recordings = recording.max() + 1
    prior = FlightPriors(np.zeros((2, 4)), np.full((2, 4), 1.0))
    priors = learn(
        fits_of(value, se, recording),
        noise_m=np.ones(recordings),
        priors=[prior] * recordings,
        of_landing=recording,
    )
    mean = np.array([one.mean[0, 3] for one in priors])
    sd = np.array([one.sd[0, 3] for one in priors])
    return mean, sd


def test_recordings_that_are_alike_have_one_law():
    alike = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        recording = np.repeat(np.arange(4), 30)
        value = 0.02 + rng.normal(0, 0.01, 120) + rng.normal(0, 0.01, 120)
        mean, _ = creeps_learned(value, 0.01, recording)
        alike += np.ptp(mean) == 0
        assert np.ptp(mean) < 0.01
    assert alike >= 16


def test_recordings_that_differ_have_means_of_their_own():
    rng = np.random.default_rng(1)
    recording = np.repeat(np.arange(5), [60, 60, 60, 60, 3])
    true = np.array([-0.06, -0.02, 0.02, 0.06, 0.2])
    value = true[recording] + rng.normal(0, 0.01, 243)
    mean, sd = creeps_learned(value, 0.002, recording)
    np.testing.assert_allclose(mean[:4], true[:4], atol=0.005)
    np.testing.assert_allclose(sd[:4], 0.01, rtol=0.25)
    # Three landings are no recording to learn from: all that differs is in their prior.
    assert abs(mean[4] - value[recording == 4].mean()) > 0.1
    assert sd[4] > 4 * sd[0]


def test_the_noise_of_few_fits_is_drawn_to_that_of_all():
    rng = np.random.default_rng(2)
    recording = np.repeat(np.arange(12), [2] * 11 + [100])
    fits = fits_of(np.zeros(122), 1.0, recording)
    noise_m = np.where(np.arange(12) == 3, 1e-3, 5e-4)
    of_landing = noise_m[recording][:, None]
    misfit = of_landing**2 * rng.chisquare(20, (122, 2))
    feet = FootHeights(np.arange(3.0), np.zeros((3, 2)), (0.08, 0.05))
    trials = Trials((feet,) * 12, recording)
    found_m = pooled_noises(replace(fits, misfit=misfit), trials, noise_m)
    np.testing.assert_allclose(found_m, noise_m, rtol=0.06)
    alone = pooled_noises(
        replace(fits, misfit=misfit), Trials((feet,), 0 * recording), noise_m[:1]
    )
    assert alone.shape == (1,)


@pytest.fixture(scope="module")
def jumps():
    """Return six trials of two landings each, levelled, and their true contacts."""
    rng = np.random.default_rng(5)
    recordings = []
    truths = []
    for number in range(6):
        positions, truth = make(KINDS["box, soft 8 ms"], 2, rng, 200.0, 6e-4)
        recording = Recording.from_arrays(
            np.arange(len(positions)) / 200.0,
            positions,
            NAMES,
            feet=("LTOE", "RTOE"),
            body=PELVIS,
            name=f"trial{number}",
        )
        recordings.append(level(recording, fit_floor(recording)))
        truths.append(truth)
    return recordings, truths


def test_the_order_of_recordings_does_not_matter(jumps):
    recordings, _ = jumps
    tables = find_study_landings(recordings)
    mixed = [recordings[k] for k in (3, 0, 5, 1, 4, 2)]
    for one, table in zip(mixed, find_study_landings(mixed), strict=True):
        pd.testing.assert_frame_equal(table, tables[recordings.index(one)])


def test_trials_of_two_landings_are_timed_better_together(jumps):
    recordings, truths = jumps
    off = {}
    for kind, tables in (
        ("together", find_study_landings(recordings)),
        ("alone", [find_landings(one) for one in recordings]),
    ):
        away = []
        for table, truth in zip(tables, truths, strict=True):
            errors_s = []
            for foot in ("LTOE", "RTOE"):
                instants = table[f"contact_{foot}_s"].dropna().to_numpy()
                every = instants - truth[foot][:, None]
                nearest = np.abs(every).argmin(axis=1)
                errors_s.append(every[np.arange(2), nearest])
            away += (errors_s[0] - errors_s[1]).tolist()
        off[kind] = np.sqrt(np.mean(np.square(away)))
    assert off["together"] < min(0.002, off["alone"])


def test_recordings_with_other_feet_are_learned_apart(jumps):
    recordings, _ = jumps
    renamed = replace(
        recordings[0],
        name="other",
        markers=tuple(name.replace("TOE", "HALLUX") for name in NAMES),
    )
    table = find_study_landings([renamed, *recordings[1:3]])[0]
    assert table.equals(find_landings(renamed))
