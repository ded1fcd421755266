"""The bundled sample by the printed methods and by hopdata's, and its truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.dissertation.sample import SAMPLE, study_of, truth_of

if TYPE_CHECKING:
    from hopdata.arrays import pd
    from hopdata.landings.sections.frames import Heights
    from hopdata.recording import Recording
    from hopdata.truth import Truth
    from hopdata.walk import Study

# The study that is measured, in a checkout.
SAMPLE_FILE = SAMPLE


@dataclass(frozen=True)
class Both:
    """The sample by the printed methods and by hopdata's, and its truth.

    `file` is the configuration of the study.
    """

    file: str
    printed: Study
    ours: Study
    truth: Truth

    @property
    def recording(self) -> Recording:
        """The recording on its level floor, which is the same in both studies."""
        return self.ours.recordings[0]


def by_both() -> Both:
    """Return the sample by both methods."""
    return Both(
        file=SAMPLE_FILE,
        printed=study_of(SAMPLE_FILE, printed=True),
        ours=study_of(SAMPLE_FILE),
        truth=truth_of(SAMPLE_FILE),
    )


def heights_in(recording: Recording) -> Heights:
    """Return the heights of the body and of the feet, frame by frame."""
    from hopdata.landings.sections.frames import heights_of

    return heights_of(recording)


def used_of(table: pd.DataFrame) -> pd.DataFrame:
    """Return the touchdowns that are not excluded."""
    return table[~table["excluded"].astype(bool)]


def instants_of(both: Both, table: pd.DataFrame) -> FloatArray:
    """Return the contacts of a table of touchdowns, (m, n), s."""
    feet = both.recording.names("foot")
    return table[[f"contact_{foot}_s" for foot in feet]].to_numpy(float)


def true_contacts(both: Both, instants: FloatArray) -> FloatArray:
    """Return the true contacts of the nearest landings, (m, n); NaN without one."""
    from hopdata.maps.truth.scoring import match_landings

    true = both.truth.contact_times[both.truth.complete]
    landing = match_landings(instants, true)
    found = np.full(instants.shape, np.nan)
    found[landing >= 0] = true[landing[landing >= 0]]
    return found


def inside_transition(both: Both, table: pd.DataFrame) -> BoolArray:
    """Mark the touchdowns (m,) whose true contacts lie in their transition."""
    true = true_contacts(both, instants_of(both, table))
    begin_s = table["t_pre_s"].to_numpy(float)
    end_s = table["t_post_s"].to_numpy(float)
    first = true.min(axis=1) >= begin_s
    return np.asarray(first & (true.max(axis=1) <= end_s))
