"""The studies that the page measures: the bundled sample and its control.

The sample is a simulated recording of the C1 hopper, seen by motion capture with noise
as printed; the control lands otherwise for each contact order. Both are read from the
folder in which the workflow runs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hopdata.analysis import study
from hopdata.config.consistency import files_of
from hopdata.config.loading import load_config
from hopdata.errors import RecordingError
from hopdata.recordings.readers.hdf5 import read_truth

if TYPE_CHECKING:
    from hopdata.truth import Truth
    from hopdata.walk import Study

SAMPLE = "config/config.yaml"
CONTROL = "config/sample_control.yaml"


def study_of(file: str = SAMPLE, *, printed: bool = False, **keys: Any) -> Study:
    """Return the study of a configuration, by the printed methods or by ours.

    Parameters
    ----------
    file
        `SAMPLE` or `CONTROL`.
    printed
        Whether each stage uses the method that the dissertation prints.
    keys
        Other sections of the configuration.
    """
    return study(file, printed=printed, **keys)


def truth_of(file: str = SAMPLE) -> Truth:
    """Return the truth of the recording of a configuration.

    Raises
    ------
    RecordingError
        If the file does not hold its truth.
    """
    (recording,) = load_config(file)["recordings"]
    (path,) = files_of(recording)
    truth = read_truth(path)
    if truth is None:
        raise RecordingError.at(path, "a recording with its truth", "none")
    return truth
