"""Landings drawn for the studies of the verdict have the same errors as those of a recording."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

from observed_landings import (
    apexes_of,
    see_landings,
    states_at,
    tracks_of,
    true_states,
)
from velocities import POST_M, PRE_M, by_section_states, hopper
from verdict_kinds import kinds
from verdict_power import gait_file, large_study, study_file

from hopdata.landings.states.fits import WINDOWS_S
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.scene import Control
from hopdata.synthesis.landings import SectionHeights, true_landings
from hopdata.synthesis.scaling import marker_states
from hopdata.synthesis.simulate import simulate_recording
from hopdata.synthesis.trial import MarkerOptions, run_trial

HOPS, SEED, NOISE_M = 400, 7, 0.0006
POINTS_M = np.array(MarkerOptions().body_m)
SECTIONS = SectionHeights(PRE_M, POST_M, POINTS_M)
HOPPER, C1 = HopperParameters(), Control()


@pytest.fixture(scope="module")
def trial():
    """Return the hops of the recording: kicks have a random stream of their own."""
    kicks = np.random.default_rng(np.random.SeedSequence(SEED).spawn(4)[0])
    return run_trial(HOPPER, hops=HOPS, rate_hz=100.0, rng=kicks)


@pytest.fixture(scope="module")
def recorded():
    """Return errors (n, B, 3) of place and velocity in a simulated recording, before and after."""
    flat = {"bowl_depth_m": 0.0, "wave_amplitude_m": 0.0}
    camera = {"floor": flat, "noise_m": NOISE_M}
    found = {}
    for seen in hopper(*simulate_recording({"hops": HOPS}, camera, seed=SEED)):
        states = by_section_states(seen)
        found[seen.side] = (
            states.position - seen.position,
            states.velocity - seen.velocity,
        )
    return found


@pytest.fixture(scope="module")
def drawn(trial):
    """Return the same errors for drawn landings."""
    apexes = apexes_of(trial)
    landings = true_landings(HOPPER, C1, apexes.after, apexes.preloads_n, SECTIONS)
    whole = np.flatnonzero(landings.whole)
    kept = type(landings)(
        *(getattr(landings, n)[whole] for n in landings.__dataclass_fields__)
    )
    rng = np.random.default_rng(1)
    until = float(kept.post_time_s.max()) + max(WINDOWS_S)
    frames = true_states(
        HOPPER, C1, apexes.some(whole), until_s=until, rate_hz=100.0, rng=rng
    )
    seen = see_landings(
        *frames, kept, SECTIONS, noise_m=NOISE_M, instant_noise_s=0.0006, rng=rng
    )
    errors = {}
    for side, found, state in (
        ("before", seen.before, kept.pre_state),
        ("after", seen.after, kept.post_state),
    ):
        misses = found - marker_states(state[seen.rows], POINTS_M)
        errors[side] = [
            part.reshape(len(part), -1, 3) for part in np.split(misses, 2, axis=1)
        ]
    return errors


@pytest.mark.parametrize("side", ["before", "after"])
@pytest.mark.parametrize("of", [0, 1])
def test_states_err_as_much_as_those_of_a_recording(recorded, drawn, side, of):
    expected, found = (
        np.sqrt(np.nanmean(errors[side][of] ** 2, axis=(0, 1)))
        for errors in (recorded, drawn)
    )
    assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(expected), rel=0.15)


def test_tracks_are_those_of_the_simulated_hopper(trial):
    """From the flight before the kick at the apex, through the landing, into the next flight."""
    apexes = apexes_of(trial)
    frames = np.arange(len(trial.states)) / trial.rate_hz
    starts = {
        hop.start_state.tobytes(): at
        for hop, at in zip(trial.hops, trial.hop_start_s, strict=True)
    }
    for number in range(5):
        one = apexes.some(np.array([number]))
        start = starts[one.after[0].tobytes()]
        lifted = trial.event_time[trial.event_time < start].max()
        shown = (frames > lifted) & (frames < start + 0.5)
        assert (frames[shown] < start - 0.08).any()
        found = states_at(HOPPER, C1, one, frames[shown] - start)[0]
        assert np.abs(found - trial.states[shown]).max() < 1e-5


def test_a_landing_has_frames_of_any_phase(trial):
    times, states = true_states(
        HOPPER,
        C1,
        apexes_of(trial),
        until_s=0.4,
        rate_hz=100.0,
        rng=np.random.default_rng(2),
    )
    tracks = tracks_of(states, POINTS_M)
    assert tracks.shape == (*times.shape, *POINTS_M.shape)
    assert np.isfinite(tracks).all()
    phases = times[:, 0] % 0.01
    assert (np.histogram(phases, bins=4, range=(0, 0.01))[0] > 0).all()
    np.testing.assert_allclose(np.diff(times, axis=1), 0.01, rtol=1e-9)


def test_bodies_and_kicks_have_gaits_of_their_own(tmp_path):
    names = [
        "softer legs",
        "stiffer legs",
        "larger kicks",
        "uneven preloads",
        "quadruped",
        "six feet",
    ]
    files = {
        gait_file(kinds()[name], tmp_path)
        for name in ["C1", *(f"C1 {n}" for n in names)]
    }
    assert len(files) == len(names) + 1


def test_studies_together_are_judged_as_one(tmp_path):
    rng = np.random.default_rng(3)
    for seed in (4, 5):
        x, y, instants = (rng.standard_normal((90, columns)) for columns in (18, 18, 3))
        study = {
            "before": x,
            "after": y,
            "instants": instants,
            "true_effect": 0.1 * seed,
        }
        np.savez(study_file("kappa 0.1", seed, tmp_path), **study)
    (row,) = json.loads(large_study("kappa 0.1", range(4, 6), tmp_path).read_text())
    assert (row["asked"], row["landings"]) == (4000, 180)
    assert row["true_effect"] == pytest.approx(0.45)
    assert large_study("kappa 0.1", range(5, 7), tmp_path) is None
