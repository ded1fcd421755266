"""Tables behind the figure of the sections: densities of heights, and some frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread, pd
from hopdata.landings.sections.densities import (
    finite,
    kde,
    normal_bandwidth,
    usual_bandwidth,
)
from hopdata.landings.sections.frames import heights_of, pooled
from hopdata.landings.sections.from_landings import (
    FIRST_CONTACT,
    LAST_CONTACT,
    LOWEST,
    TOP,
    landing_heights,
)
from hopdata.landings.sections.poincare import Sections
from hopdata.recording import Recording

FEET = ("min_foot", "max_foot")

#: Bandwidth of the densities of feet, in deviations of the ground mode; it widens the
#: mode by 12 %.
#: Unit: deviations. Origin: chosen.
FOOT_BANDWIDTH = 0.5

#: Smallest bandwidth of the densities of feet, as a share of the range of heights, for
#: data without noise.
#: Unit: 1. Origin: chosen.
FINEST_BANDWIDTH = 1e-5

# Reach of a curve beyond its heights, in bandwidths.
REACH_OF_FEET = 4
REACH_OF_BODIES = 3


@one_blas_thread()
def section_densities(
    recordings: Sequence[Recording],
    sections: Sections,
    landings: Mapping[str, pd.DataFrame],
    *,
    nodes: int = 1024,
) -> pd.DataFrame:
    """Estimate densities of heights of feet, of the body given the feet, in landings.

    Parameters
    ----------
    recordings : sequence of Recording
        Recordings from which the sections were selected, above the floor.
    sections : Sections
        Sections whose thresholds divide the frames and determine which are used.
    landings : mapping
        Landings of each recording by name.
    nodes : int
        Nodes of each curve, >= 2.

    Returns
    -------
    DataFrame
        Columns curve, height_m and density_per_m, with `nodes` rows for each curve. The
        curves ``min_foot`` and ``max_foot`` are of all frames. The curves ``body_all``,
        ``body_given_all_up``, ``body_given_all_down``, ``body_given_some_down`` and
        ``body_given_some_up`` are of the pooled frames. The curves ``top``,
        ``first_contact``, ``last_contact`` and ``lowest`` are of the body's heights in
        landings of all feet. A condition that fewer than two frames or landings meet,
        or that leaves only one height, has no curve. The curves by which the rule chose
        have its bandwidth.
    """
    heights = [heights_of(recording) for recording in recordings]
    in_each = [landing_heights(one, landings[one.name]) for one in recordings]
    of_landings = np.concatenate(in_each)
    frames = sections.pooled(heights)
    bodies = {
        "body_all": frames.body,
        "body_given_all_up": frames.body[frames.all_up],
        "body_given_all_down": frames.body[frames.all_down],
        "body_given_some_down": frames.body[~frames.all_up],
        "body_given_some_up": frames.body[~frames.all_down],
    }
    in_landings = {
        "top": of_landings[:, TOP],
        "first_contact": of_landings[:, FIRST_CONTACT],
        "last_contact": of_landings[:, LAST_CONTACT],
        "lowest": of_landings[:, LOWEST],
    }
    bodies = _with_spread(bodies)
    in_landings = _with_spread(in_landings)
    feet = {foot: finite(pooled([getattr(h, foot) for h in heights])) for foot in FEET}
    range_m = feet["max_foot"].max() - feet["min_foot"].min()
    finest_m = FINEST_BANDWIDTH * float(range_m)
    foot_widths = []
    for foot in FEET:
        sigma_m = getattr(sections, f"{foot}_mode").sigma_m
        foot_widths.append(max(FOOT_BANDWIDTH * sigma_m, finest_m))
    body_widths = [normal_bandwidth(one) for one in bodies.values()]
    landing_widths = [
        usual_bandwidth([one], np.ptp(one)) for one in in_landings.values()
    ]
    if sections.bandwidth_m is not None and sections.rule == "landings":
        landing_widths = [sections.bandwidth_m] * len(in_landings)
    if sections.bandwidth_m is not None and sections.rule == "printed":
        foot_widths = [sections.bandwidth_m] * len(feet)
        body_widths = [sections.bandwidth_m] * len(bodies)
    tables = [
        *_curves(feet, foot_widths, REACH_OF_FEET, nodes),
        *_curves(bodies, body_widths, REACH_OF_BODIES, nodes),
        *_curves(in_landings, landing_widths, REACH_OF_BODIES, nodes),
    ]
    return pd.concat(tables, ignore_index=True)


def _with_spread(groups: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the groups of heights that have a density: two or more that differ."""
    kept = {}
    for name, heights in groups.items():
        if len(heights) > 1 and np.ptp(heights) > 0:
            kept[name] = heights
    return kept


def _curves(
    groups: Mapping[str, FloatArray], widths: Sequence[float], reach: float, nodes: int
) -> list[pd.DataFrame]:
    """Return densities of groups of heights; the grid extends by `reach` widths."""
    margin = reach * max(widths, default=0.0)
    low = min(map(np.min, groups.values()), default=0.0) - margin
    high = max(map(np.max, groups.values()), default=0.0) + margin
    grid = np.linspace(low, high, nodes)
    tables = []
    for (name, heights), width in zip(groups.items(), widths, strict=True):
        density = kde(heights, bandwidth=width, grid=grid)
        columns = {"curve": name, "height_m": grid, "density_per_m": density}
        tables.append(pd.DataFrame(columns))
    return tables


def section_frames(
    recordings: Sequence[Recording], sections: Sections, max_rows: int = 20000
) -> pd.DataFrame:
    """Tabulate heights of feet and body, and the state, in every k-th frame.

    Parameters
    ----------
    recordings : sequence of Recording
        Above the floor.
    sections : Sections
        Sections whose thresholds define a landing.
    max_rows : int
        Largest number of rows; k is the smallest step that keeps to it.

    Returns
    -------
    DataFrame
        Columns min_foot_m, max_foot_m and body_m, for frames in which all three are
        seen, and landing: whether the body is on its way from all feet up to all feet
        down.
    """
    heights = [heights_of(recording) for recording in recordings]
    columns = {}
    for name in (*FEET, "body"):
        in_each = [getattr(one, name)[one.seen] for one in heights]
        columns[f"{name}_m"] = np.concatenate(in_each)
    low_m = sections.min_foot_threshold_m
    high_m = sections.max_foot_threshold_m
    landing = [one.landing(low_m, high_m)[one.seen] for one in heights]
    columns["landing"] = np.concatenate(landing)
    stride = max(1, -(-len(columns["body_m"]) // max_rows))
    return pd.DataFrame({name: values[::stride] for name, values in columns.items()})
