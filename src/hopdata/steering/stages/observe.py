"""From recordings in which the boom moves to the table of frame changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.blas import one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.recordings.recording import Recording
from hopdata.steering.frame_changes import FrameChanges, frame_changes, joined
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.motion import HopperMotion, hopper_motion
from hopdata.steering.observation.stance_states import StanceStates, stance_states
from hopdata.steering.observation.stances import Stances, find_stances

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Observed:
    """What the recordings tell.

    Parameters
    ----------
    geometry : HopperGeometry
        Of the first recording; live use begins with it.
    changes : FrameChanges
        Hops of all recordings, those not used included.
    stances, motion : DataFrame
        One row a stance, and one row a frame, of all recordings.
    counts : list of mappings
        Frames by status, stances, hops, and what was left out with its reason, by recording.
    """

    geometry: HopperGeometry
    changes: FrameChanges
    stances: pd.DataFrame
    motion: pd.DataFrame
    counts: list[dict[str, Any]]


@one_blas_thread()
def observe_recordings(recordings: Sequence[Recording], *, swing_limit_rad: float) -> Observed:
    """Observe pose, boom angle and stances, and collect the frame changes.

    Parameters
    ----------
    recordings : sequence of Recording
        Each is calibrated by itself: markers may have been glued anew.
    swing_limit_rad : float
        Largest swing that was commanded.

    Raises
    ------
    AnalysisError
        If a recording has no boom marker, or cannot be calibrated; it is named.
    """
    import pandas as pd

    parts = [_observed(recording, swing_limit_rad) for recording in recordings]
    return Observed(
        geometry=parts[0].geometry,
        changes=joined(part.changes for part in parts),
        stances=pd.concat([part.stances for part in parts], ignore_index=True),
        motion=pd.concat([part.motion for part in parts], ignore_index=True),
        counts=[count for part in parts for count in part.counts],
    )


def _observed(recording: Recording, swing_limit_rad: float) -> Observed:
    if not recording.indices("boom"):
        raise AnalysisError(
            f"{recording.name}: expected a marker with the role boom (markers.boom), on whose "
            f"angle the frame changes depend, found only {', '.join(recording.markers)}"
        )
    try:
        geometry = calibrate(recording)
    except AnalysisError as error:
        raise AnalysisError(f"{recording.name}: {error}") from None
    motion = hopper_motion(recording, geometry)
    band = (geometry.stance_below_m, geometry.flight_above_m)
    stances = find_stances(motion.time, motion.height, band)
    states = stance_states(motion, stances)
    changes = frame_changes(
        states.time_s,
        states.pose,
        states.boom_angle_rad,
        states.pairs,
        swing_limit_rad=swing_limit_rad,
        recording=recording.name,
        tilts_rad=states.tilt_rad,
    )
    return Observed(
        geometry,
        changes,
        _stance_table(recording.name, stances, states),
        _motion_table(recording.name, motion),
        [_counts(recording.name, motion, stances, changes)],
    )


def _counts(
    name: str, motion: HopperMotion, stances: Stances, changes: FrameChanges
) -> dict[str, Any]:
    return {
        "recording": name,
        "frames": motion.counts,
        "stances": len(stances.time_s),
        "pairs": len(stances.pairs),
        "rejected": stances.rejected,
        "used": len(changes.used()),
        "excluded": changes.excluded(),
    }


def _stance_table(name: str, stances: Stances, states: StanceStates) -> pd.DataFrame:
    import pandas as pd

    x, y, heading = states.pose.T
    follows = np.zeros(len(stances.time_s), dtype=bool)
    follows[stances.pairs[:, 1]] = True
    return pd.DataFrame(
        {
            "recording": name, "frame": stances.frame, "time_s": stances.time_s,
            "height_m": stances.height_m, "x_m": x, "y_m": y, "heading_rad": heading,
            "boom_angle_rad": states.boom_angle_rad, "tilt_rad": states.tilt_rad,
            "follows": follows,
        }
    )  # fmt: skip


def _motion_table(name: str, motion: HopperMotion) -> pd.DataFrame:
    import pandas as pd

    x, y, heading = motion.pose.T
    return pd.DataFrame(
        {
            "recording": name, "time_s": motion.time, "x_m": x, "y_m": y, "heading_rad": heading,
            "height_m": motion.height, "boom_angle_rad": motion.boom_angle_rad,
            "residual_m": motion.residual, "status": motion.status,
        }
    )  # fmt: skip
