"""The steering studies that the page measures: with `printed: true`, and without.

Each is the study that ``snakemake steering`` makes of a configuration without other
keys: the excitation of the simulated robot, what motion capture sees of it, and the
model of the frame change.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.config.loading import load_config
from hopdata.recording import Recording
from hopdata.steering import PRINTED
from hopdata.steering.frame_changes import FrameChanges, StanceStates, frame_changes
from hopdata.steering.models.learning import learn
from hopdata.steering.observation.observe import Observed, observe_recordings
from hopdata.steering.trial import POSE, SteeredTrial, simulate_excitation

if TYPE_CHECKING:
    from hopdata.arrays import pd
    from hopdata.steering.models.process import FrameChangeProcess


def config_of(*, printed: bool, **steering: Any) -> dict[str, Any]:
    """Return the configuration of a steering study.

    Parameters
    ----------
    printed : bool
        Whether it says ``printed: true``.
    steering
        Keys of the block ``steering``, if any.
    """
    markers = {
        "body": ["body1", "body2", "body3"],
        "feet": ["foot1", "foot2", "foot3"],
        "boom": ["boom"],
    }
    return load_config(
        {
            "study": "dissertation",
            "printed": printed,
            "recordings": [{"name": "none"}],
            "markers": markers,
            "steering": steering,
        }
    )


@dataclass(frozen=True)
class Learned:
    """A steering study up to its model.

    Attributes
    ----------
    config
        Its configuration.
    seed
        The seed of all that is random in it.
    trial
        The recorded excitation, with the truth.
    observed
        What was seen of it.
    process
        The model.
    scores
        Its errors on the hops that it has not learned from.
    """

    config: Mapping[str, Any]
    seed: np.random.SeedSequence
    trial: SteeredTrial
    observed: Observed
    process: FrameChangeProcess
    scores: pd.DataFrame

    @property
    def recording(self) -> Recording:
        """The recording of the excitation."""
        return self.trial.recording

    @property
    def is_printed(self) -> bool:
        """Whether it was observed as printed."""
        return str(self.config["steering"]["observations"][0]) == PRINTED

    @property
    def swing_limit_rad(self) -> float:
        """The largest swing of the robot."""
        return float(self.config["steering"]["robot"]["swing_limit_rad"])


def learned(seed: int, *, printed: bool, **keys: Any) -> Learned:
    """Excite, observe and learn, as the study's first seed does; see `config_of`."""
    config = config_of(printed=printed, **keys)
    steering = config["steering"]
    stream = np.random.SeedSequence(seed, spawn_key=(1,))
    (observation,) = steering["observations"]
    trial = simulate_excitation(
        steering, config["motion_capture"], seed=stream, observation=observation
    )
    observed = observe_recordings(
        [trial.recording],
        swing_limit_rad=steering["robot"]["swing_limit_rad"],
        observation=observation,
    )
    process, scores = learn(observed.changes, steering["model"], seed=stream)
    return Learned(config, stream, trial, observed, process, scores)


def true_changes(trial: SteeredTrial, swing_limit_rad: float) -> FrameChanges:
    """Return the hops of a trial as they truly were."""
    stances = trial.stances
    second = np.flatnonzero(stances["follows"])
    states = StanceStates(
        time_s=stances["time_s"].to_numpy(),
        pose=stances[POSE].to_numpy(),
        boom_angle_rad=stances["boom_angle_rad"].to_numpy(),
        pairs=np.column_stack([second - 1, second]),
        tilt_rad=np.full(len(stances), np.nan),
    )
    return frame_changes(states, swing_limit_rad=swing_limit_rad)


def rms(errors: FloatArray) -> float:
    """Return the root mean square of what is known of the errors."""
    return float(np.sqrt(np.nanmean(np.square(errors))))
