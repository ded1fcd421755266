"""Errors that all contacts share because positions are not the cameras' own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hopdata.landings.contacts.judged import Contacts
from hopdata.recording import Recording
from hopdata.recordings.quality.processing import (
    frames_of_pattern,
    low_pass,
    middle,
)

#: Delay of contacts by a low-pass filter, in periods of its cut-off (17 ms at 12 Hz);
#: this is stated as an error that all contacts share.
#: Unit: periods. Origin: measured: docs/contacts_method.md, "Positions that are not the
#: cameras' own".
FILTER_DELAYS = 0.21

#: Error that all contacts share after positions were brought to another rate, in frames
#: of the rate before.
#: Unit: frames. Origin: measured: contacts at 100 Hz that straight lines brought to
#: another rate were off by up to 3.4 ms.
RESAMPLED_FRAMES = 0.35


def resampled_error(recording: Recording) -> float:
    """Return the error, s, that contacts share after a change of the rate; else 0.

    It is that of an animal of 1 m.
    """
    if not recording.indices("body"):
        return 0.0
    period = frames_of_pattern(middle(recording.body))
    frame_s = 1 / recording.rate_hz / recording.time_scale
    return RESAMPLED_FRAMES * period * frame_s


def with_processing(recording: Recording, contacts: Contacts) -> Contacts:
    """Add to the common error what a filter or another rate did to contacts."""
    if not recording.indices("body"):
        return contacts
    frame_s = 1 / recording.rate_hz / recording.time_scale
    early_s = resampled_error(recording)
    late_s = 0.0
    cut_off = low_pass(recording.body, scale=recording.scale)
    if cut_off:
        late_s = FILTER_DELAYS / cut_off * frame_s
    if not max(early_s, late_s) > 0:
        return contacts
    return replace(contacts, common=np.maximum(contacts.common, early_s + late_s))
