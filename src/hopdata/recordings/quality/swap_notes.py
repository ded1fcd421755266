"""Exchanged names of a recording that is to be analysed, in words."""

from __future__ import annotations

from hopdata.recordings.quality.one_sided import surprises
from hopdata.recordings.quality.rigid import frame_noise, pair_distances, rigid_clusters
from hopdata.recordings.quality.swaps import Swap, find_swaps
from hopdata.recordings.recording import Recording


def swap_notes(recording: Recording) -> list[str]:
    """Say which markers seem to have exchanged their names, and when; nothing is corrected.

    Parameters
    ----------
    recording : Recording
        As imported.

    Returns
    -------
    list of str
        One sentence each; times count from the first frame, frames from 1.
    """
    positions, markers = recording.positions, recording.markers
    pairs = pair_distances(positions)
    swaps = find_swaps(
        positions,
        markers,
        missed=surprises(positions),
        pairs=pairs,
        clusters=rigid_clusters(pairs, frame_noise(positions)),
        rate_hz=recording.rate_hz,
    )
    return [f"{recording.name}: {_in_words(swap, recording)}" for swap in swaps]


def _in_words(swap: Swap, recording: Recording) -> str:
    names = " and ".join(swap.markers) if len(swap.markers) == 2 else ", ".join(swap.markers)
    begin = float(recording.time[swap.start] - recording.time[0])
    if swap.stop is None:
        until = "to the end"
    else:
        end = float(recording.time[swap.stop - 1] - recording.time[0])
        until = f"to {end:.2f} s (frame {swap.stop})"
    return (
        f"{names} seem to have exchanged their names from {begin:.2f} s (frame {swap.start + 1}) "
        f"{until}, by {' and '.join(swap.found_by)}; the analysis takes them as they are"
    )
