"""The stages of a steering study: options to robot, trial to hops, hops to a model, its score."""

from dataclasses import replace

import numpy as np
import pytest

from hopdata.config.loading import load_config
from hopdata.errors import AnalysisError, RecordingError
from hopdata.recording import Recording
from hopdata.steering.excitation import ControlGrid, eulerian_excitation
from hopdata.steering.experiments.outcomes import truth_entries
from hopdata.steering.frame_changes import TILTED, FrameChanges
from hopdata.steering.models import learning as learning_curve
from hopdata.steering.models.learning import learn, learning_tables
from hopdata.steering.models.training import PRINTED, RECOMMENDED, process_of
from hopdata.steering.observation.observe import observe_recordings
from hopdata.steering.robot import SteeredHopper, robot_and_camera
from hopdata.steering.strides import USED
from hopdata.steering.trial import (
    TrueFrameChanges,
    record_trial,
    simulate_excitation,
    true_map_of,
    true_map_table,
)
from hopdata.synthesis.camera import MotionCapture


@pytest.fixture(scope="module")
def config():
    return load_config("config/config.yaml", check_files=False)


@pytest.fixture(scope="module")
def trial(config):
    """Return a short excitation and its truth: 3 x 24 hops."""
    excitation = {"n_angles": 8, "n_steps": 1, "repeats": 3}
    steering = {**config["steering"], "excitation": excitation}
    return simulate_excitation(
        steering, config["motion_capture"], seed=np.random.SeedSequence(5)
    )


@pytest.fixture(scope="module")
def observed(trial):
    return observe_recordings([trial.recording], swing_limit_rad=3 * np.pi / 8)


def rng(seed=0):
    return np.random.default_rng(np.random.SeedSequence(seed))


def test_the_defaults_of_the_configuration_are_those_of_the_robot_and_the_camera(
    config,
):
    robot, camera = robot_and_camera(
        config["steering"]["robot"], config["motion_capture"]
    )
    standard = SteeredHopper()
    assert camera == MotionCapture()
    assert robot.swing_limit_rad == pytest.approx(standard.swing_limit_rad, rel=1e-15)
    for name in (
        "hopper",
        "preload_shares",
        "kicks",
        "markers",
        "release_height_m",
        "hop_limit_s",
    ):
        assert getattr(robot, name) == getattr(standard, name), name


def test_the_excitation_and_the_kernel_are_those_configured(config):
    grid = ControlGrid(**config["steering"]["excitation"])
    assert len(eulerian_excitation(grid, rng())) == 336
    assert process_of({"kernel": "printed"}) is PRINTED
    assert process_of({"kernel": "recommended"}) is RECOMMENDED


def test_the_trial_s_truth_is_by_stance_and_by_frame(trial):
    recording, stances, motion = trial.recording, trial.stances, trial.motion
    assert len(motion) == len(recording.time)
    assert stances["follows"].sum() >= 60
    assert recording.names("boom") == ("boom",)


def test_hops_are_observed_and_all_accounted_for(trial, observed):
    count = observed.counts[0]
    assert count["pairs"] == len(observed.changes) == trial.stances["follows"].sum()
    assert count["used"] + sum(count["excluded"].values()) == count["pairs"]
    assert sum(count["frames"].values()) == len(trial.recording.time)
    assert observed.stances["follows"].sum() == count["pairs"]
    assert observed.geometry.boom_name == "boom"


def test_recordings_are_joined_one_after_the_other(trial, observed):
    both = observe_recordings(
        [trial.recording, trial.recording], swing_limit_rad=3 * np.pi / 8
    )
    assert len(both.changes) == 2 * len(observed.changes)
    assert [count["recording"] for count in both.counts] == ["excitation"] * 2


def test_a_recording_without_a_boom_is_refused_in_words(trial):
    whole = trial.recording
    keep = [i for i, role in enumerate(whole.roles) if role != "boom"]
    bare = Recording(
        name="monday",
        time=whole.time,
        positions=whole.positions[:, keep],
        markers=tuple(whole.markers[i] for i in keep),
        roles=tuple(whole.roles[i] for i in keep),
        rate_hz=whole.rate_hz,
        source="test",
    )
    with pytest.raises(
        AnalysisError, match="monday: expected a marker with the role boom"
    ):
        observe_recordings([bare], swing_limit_rad=1.2)


def test_which_recording_cannot_be_calibrated_is_said(trial):
    whole = trial.recording
    boom, body = whole.indices("boom")[0], whole.indices("body")[0]
    positions = whole.positions.copy()
    positions[:, boom] = positions[:, body]
    still = replace(whole, name="tuesday", positions=positions)
    with pytest.raises(AnalysisError, match="tuesday: boom: expected it to move"):
        observe_recordings([whole, still], swing_limit_rad=1.2)


def test_hops_of_a_robot_that_tips_over_are_left_out_and_counted():
    robot = replace(
        SteeredHopper(), preload_shares=(0.6, 1.3, 1.1)
    )  # one leg carries little
    trial = record_trial(robot, [0.5, -0.5] * 12, seed=3)
    seen = observe_recordings([trial.recording], swing_limit_rad=1.2)
    stances, count = seen.stances, seen.counts[0]
    true = trial.motion["tilt_rad"][stances["frame"] - 1]
    np.testing.assert_allclose(
        stances["tilt_rad"], true, atol=np.deg2rad(3)
    )  # level by its feet
    tilted = (stances["tilt_rad"] > np.deg2rad(20)).to_numpy()
    follows = np.flatnonzero(stances["follows"])
    from_or_to = tilted[follows] | tilted[follows - 1]
    assert count["excluded"] == {TILTED: from_or_to.sum()}
    assert count["excluded"][TILTED] > 10
    assert seen.changes.reason.tolist() == [
        TILTED if over else USED for over in from_or_to
    ]


MODEL = {"kernel": "recommended", "training_hops": 60}
SEED = np.random.SeedSequence(1)


def hops(n=150, seed=3):
    """Return hops by a simple law, with a little noise."""
    stream = rng(seed)
    angle, swing = stream.uniform(0, 2 * np.pi, n), stream.uniform(-1.1, 1.1, n)
    return FrameChanges.hops(
        recording=np.full(n, "a"), time_s=np.arange(n) * 0.6, boom_angle_rad=angle,
        swing_rad=swing, change=law(angle, swing) + 1e-3 * stream.standard_normal((n, 3)),
        reason=np.full(n, USED, dtype="<U32"),
    )  # fmt: skip


def law(angle, swing):
    return np.column_stack(
        [
            0.05 - 0.03 * np.cos(angle),
            0.02 * np.sin(angle),
            0.1 * swing + 0.02 * np.sin(angle),
        ]
    )


def test_a_recording_with_hardly_a_hop_is_not_blamed_on_the_configuration():
    with pytest.raises(
        AnalysisError, match=r"steering: expected at least 12 hops .* found 11"
    ):
        learn(hops(11), MODEL, seed=SEED)


def test_a_model_is_tested_on_the_hops_that_it_has_not_seen():
    process, scores = learn(hops(), MODEL, seed=SEED)
    assert len(process.points) == 60
    assert scores["test_hops"].tolist() == [90] * 3
    assert scores["r2"].min() > 0.9
    other, _ = learn(hops(), MODEL, seed=np.random.SeedSequence(2))
    assert not np.array_equal(process.points, other.points)
    again, _ = learn(hops(), MODEL, seed=SEED)
    np.testing.assert_array_equal(process.points, again.points)


def test_too_few_hops_are_told_with_what_was_left_out():
    few = hops(40)
    few.reason[:5] = "pose missing"
    with pytest.raises(
        AnalysisError, match=r"at most 33, .* found 60 .*'pose missing': 5"
    ):
        learn(few, MODEL, seed=SEED)


def test_a_learning_curve_is_refused_before_anything_is_learned(monkeypatch):
    monkeypatch.setattr(learning_curve, "learning_scores", None)
    with pytest.raises(
        AnalysisError, match=r"at most 98, .* the 100 hops .* found 120"
    ):
        learning_tables(hops(100), training_hops=120, draws=2, seed=1)
    with pytest.raises(
        AnalysisError, match=r"learning curve: expected at least 50 .* found 49"
    ):
        learning_tables(hops(49), training_hops=20, draws=2, seed=1)


def true_map():
    angle, swing = 2 * np.pi * np.arange(6) / 6, np.linspace(-1, 1, 5)
    grid = [axis.ravel() for axis in np.meshgrid(angle, swing, swing, indexing="ij")]
    change = law(*grid[:2]) + 0.01 * grid[2][:, None]
    return TrueFrameChanges(angle, swing, swing, change.reshape(6, 5, 5, 3))


def test_the_true_map_survives_its_table():
    table = true_map_table(true_map())
    found = true_map_of(table)
    np.testing.assert_array_equal(found.change, true_map().change)
    np.testing.assert_array_equal(found.swing_rad, true_map().swing_rad)
    with pytest.raises(RecordingError, match="expected a grid"):
        true_map_of(table.iloc[:-1])


class Law:
    """A model that knows the law except for a constant error."""

    def change(self, angle, swing):
        return law(angle, swing) + np.array([1e-3, 0.0, 0.0])


def test_scores_against_the_truth(trial, observed):
    stances, motion = trial.stances, trial.motion
    entries = truth_entries(
        observed.motion, motion, observed.stances, stances, Law(), true_map()
    )
    value = {name: entry["value"] for name, entry in entries.items()}
    assert value["true_pairs"] == stances["follows"].sum()
    assert value["missed_pairs"] == value["invented_pairs"] == 0
    assert 1.0 < value["heading_rms"] < 4.0, "mrad"
    assert value["boom_angle_rms"] < 6.0, "mrad"
    assert value["model_x_rms"] == pytest.approx(1.0, rel=1e-9), "mm"
    assert value["model_y_rms"] == pytest.approx(0.0, abs=1e-9)
    lost = stances.copy()
    lost.loc[10, "follows"] = False
    entries = truth_entries(observed.motion, motion, lost, stances, Law(), true_map())
    assert entries["missed_pairs"]["value"] == 1
    entries = truth_entries(
        observed.motion, motion, observed.stances, lost, Law(), true_map()
    )
    assert entries["invented_pairs"]["value"] == 1
