"""Sec. 2.2: from the recording to labelled touchdowns, by both methods on the sample.

The bundled sample was simulated, so its truth is known: each stage is scored by it.
What is random is repeated on new recordings, one a seed. The rows are made in
`hopdata.dissertation.labelling`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from hopdata.arrays import pd
from hopdata.dissertation.labelling import (
    home,
    recorded,
    robot,
    sections,
    touchdowns,
)
from hopdata.dissertation.labelling.sample_by_both import by_both
from hopdata.dissertation.rows import Made

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hopdata.dissertation.labelling.sample_by_both import Both

#: Frames that a figure shows.
#: Unit: frames. Origin: chosen.
SHOWN_FRAMES = 8000


def make(seeds: Sequence[int]) -> Made:
    """Measure items 11 and 15 to 31; see `hopdata.dissertation.parts`."""
    both = by_both()
    again = [recorded.thesis_trial(seed) for seed in seeds]
    rows = [
        robot.boom(),
        robot.preload(),
        robot.drop_test(),
        robot.markers(both),
        recorded.frames_and_hops(again, seeds),
        recorded.noise(both, seeds),
        recorded.floor(both),
        sections.level_sets(both),
        sections.two_modes(both),
        sections.thresholds(both),
        sections.section_heights(both, again),
        sections.section_figure(both),
        touchdowns.velocity_minimum(both),
        touchdowns.default_labels(both),
        touchdowns.excluded(both),
        touchdowns.schedule_figure(both),
        home.home_frame(both, seeds),
        home.units(both),
    ]
    return Made(rows, _tables(both))


def draw(tables: Mapping[str, pd.DataFrame]) -> Mapping[str, Figure]:
    """Draw Figs. 2.2 and 2.3 by both methods."""
    from hopdata.dissertation.figures import labels

    return {
        "fig2_2_both": labels.sections_by_both(tables),
        "fig2_3_both": labels.schedule_by_both(tables),
    }


def _tables(both: Both) -> dict[str, pd.DataFrame]:
    """Return what the figures draw, by both methods."""
    from hopdata.landings.sections.tables import section_densities, section_frames

    tables = {}
    rows = []
    for name, found in (("printed", both.printed), ("ours", both.ours)):
        chosen = found.sections
        recordings = found.recordings
        tables[f"{name}_densities"] = section_densities(
            recordings, chosen, found.contacts
        )
        tables[f"{name}_frames"] = section_frames(
            recordings, chosen, max_rows=SHOWN_FRAMES
        )
        rows.append(
            {
                "method": name,
                "rule": chosen.rule,
                "frames": chosen.frames,
                "pre_height_m": chosen.pre_height_m,
                "post_height_m": chosen.post_height_m,
                "min_foot_threshold_m": chosen.min_foot_threshold_m,
                "max_foot_threshold_m": chosen.max_foot_threshold_m,
            }
        )
    tables["sections"] = pd.DataFrame(rows)
    return tables | touchdowns.examples_of(both)
