"""Recordings with their truth, which only scoring reads again."""

from pathlib import Path

from hopdata.recording import Recording
from hopdata.recordings.readers.hdf5 import write_recording
from hopdata.truth import Truth

#: A recording, and its truth if that is known.
WithTruth = tuple[Recording, Truth | None]


def write_with_truth(path: str | Path, found: WithTruth) -> None:
    """Write a recording, with the truth if there is one."""
    recording, truth = found
    write_recording(path, recording, truth=truth)


def without_truth(found: WithTruth) -> Recording:
    """Return the recording, as a stage would read it."""
    recording, _ = found
    return recording
