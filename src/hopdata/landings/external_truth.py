"""All that is known from elsewhere of a study's recordings, beside what hopdata found in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hopdata.landings.contact_overlay import compare_contacts
from hopdata.landings.force_contacts import contact_times_of
from hopdata.landings.overlay_example import example_landing, threshold_table
from hopdata.landings.overlay_summary import summarise_overlay
from hopdata.recordings.external_contacts import read_contact_times
from hopdata.recordings.force_signals import read_force_signals
from hopdata.recordings.recording import Recording

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class ExternalTruth:
    """Tables of the overlay.

    Parameters
    ----------
    contacts : pandas.DataFrame
        One row a contact, see `compare_contacts`.
    summary : pandas.DataFrame
        One row a column, see `summarise_overlay`.
    thresholds : pandas.DataFrame
        See `threshold_table`; without rows where there are no forces.
    example : pandas.DataFrame
        See `example_landing`.
    """

    contacts: pd.DataFrame
    summary: pd.DataFrame
    thresholds: pd.DataFrame
    example: pd.DataFrame


def overlay_external_truth(
    recordings: Sequence[Recording],
    touchdowns: pd.DataFrame,
    configured: Mapping[str, Mapping[str, Any]],
    *,
    window_s: float,
    rate_hz: float | None = None,
) -> ExternalTruth:
    """Read what is known from elsewhere and compare it with the contacts found.

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled; those for which something is known.
    touchdowns : pandas.DataFrame
        Touchdowns of the study.
    configured : mapping
        By recording name, the blocks ``contacts`` and ``forces`` of the configuration.
    window_s : float
        ``external.window_s``.
    rate_hz : float, optional
        ``input.rate_hz``.
    """
    import pandas as pd

    contacts, thresholds, examples = [], [], []
    for recording in recordings:
        blocks, feet = configured[recording.name], recording.names("foot")
        own = touchdowns[touchdowns["recording"] == recording.name].reset_index(drop=True)
        known, signals = [], []
        if blocks["contacts"]["file"] is not None:
            known += read_contact_times(blocks["contacts"], feet=feet, rate_hz=rate_hz)
        if blocks["forces"]["file"] is not None:
            signals = read_force_signals(blocks["forces"], feet=feet)
            known += [contact_times_of(signal) for signal in signals]
        compared = [compare_contacts(recording, own, one, window_s=window_s) for one in known]
        contacts += compared
        thresholds += [threshold_table(recording, own, s, window_s=window_s) for s in signals]
        shown = pd.concat(compared[-len(signals) :], ignore_index=True)  # forces where there are
        examples.append(example_landing(recording, shown, signals))
    table = pd.concat(contacts, ignore_index=True)
    return ExternalTruth(
        contacts=table,
        summary=summarise_overlay(table),
        thresholds=pd.concat(thresholds, ignore_index=True) if thresholds else _no_thresholds(),
        example=next((one for one in examples if len(one)), examples[0]),
    )


def _no_thresholds() -> pd.DataFrame:
    import pandas as pd

    columns = ("recording", "column", "threshold", "unit", "n_matched", "n_missed", "n_invented")
    return pd.DataFrame(columns=[*columns, "bias_s", "robust_sd_s"])
