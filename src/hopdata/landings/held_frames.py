"""Frames that a system repeated because it lost its cameras: they count as unseen."""

from dataclasses import replace

import numpy as np

from hopdata.recording import Recording
from hopdata.recordings.quality import repeats


def without_held_frames(recording: Recording) -> Recording:
    """Return a recording in which frames that repeat the one before are unseen.

    States and contacts would otherwise be fitted to a body that seems to stop in the
    air and then to jump. `hopdata.recordings.quality.inspection` tells of each.

    Parameters
    ----------
    recording : Recording
        It is returned as it is if no frame is held.
    """
    held = repeats.held_frames(recording.positions)
    if not held:
        return recording
    positions = recording.positions.copy()
    for start, stop in held:
        positions[start:stop] = np.nan
    return replace(recording, positions=positions)
