"""Tables behind the figure of the sections: densities of heights, and a sample of frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.landings.contact_frames import Heights, heights_of, pool_frames
from hopdata.landings.density import finite, kde, normal_bandwidth
from hopdata.landings.sections import Sections
from hopdata.recordings.recording import Recording

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

_FOOT_BANDWIDTH = 0.5  # in deviations of the ground mode: widens it by 12 %
_FINEST = 1e-5  # of the range of heights: the least bandwidth


@one_blas_thread()
def section_densities(
    recordings: Sequence[Recording], sections: Sections, *, nodes: int = 1024
) -> pd.DataFrame:
    """Densities of foot heights, and of body height given what the feet do.

    Parameters
    ----------
    recordings : sequence of Recording
        Those that the sections were selected from, above the floor.
    sections : Sections
        Their thresholds divide the frames, and say which frames are used.
    nodes : int
        Nodes of each curve, >= 2.

    Returns
    -------
    DataFrame
        Columns curve, height_m and density_per_m, `nodes` rows a curve. Curves ``min_foot`` and
        ``max_foot`` are of all frames; ``body_all``, ``body_given_all_up``,
        ``body_given_all_down``, ``body_given_some_down`` and ``body_given_some_up`` of the
        frames that the sections are made from. A condition that fewer than two frames meet, or
        that leaves but one height, has no curve.
    """
    import pandas as pd

    heights = [heights_of(recording) for recording in recordings]
    curves = _foot_curves(heights, sections, nodes) | _body_curves(heights, sections, nodes)
    tables = [
        pd.DataFrame({"curve": name, "height_m": grid, "density_per_m": density})
        for name, (grid, density) in curves.items()
    ]
    return pd.concat(tables, ignore_index=True)


def section_frames(recordings: Sequence[Recording], max_rows: int = 20000) -> pd.DataFrame:
    """Every k-th frame's lowest foot, highest foot and body height.

    Parameters
    ----------
    recordings : sequence of Recording
        Above the floor.
    max_rows : int
        Rows at most; k is the smallest that keeps to it.

    Returns
    -------
    DataFrame
        Columns min_foot_m, max_foot_m and body_m, of frames in which all of them are seen.
    """
    import pandas as pd

    heights = [heights_of(recording) for recording in recordings]
    columns = {
        f"{name}_m": np.concatenate([getattr(h, name)[h.seen] for h in heights])
        for name in ("min_foot", "max_foot", "body")
    }
    stride = max(1, -(-len(columns["body_m"]) // max_rows))
    return pd.DataFrame({name: values[::stride] for name, values in columns.items()})


def _foot_curves(
    heights: Sequence[Heights], sections: Sections, nodes: int
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Densities of the lowest and the highest foot, on one grid."""
    lowest = finite(np.concatenate([h.min_foot for h in heights]))
    highest = finite(np.concatenate([h.max_foot for h in heights]))
    widths = [_FOOT_BANDWIDTH * m.sigma_m for m in (sections.min_foot_mode, sections.max_foot_mode)]
    least = _FINEST * float(highest.max() - lowest.min())
    widths = [max(width, least) for width in widths]  # heights without noise
    margin = 4 * max(widths)
    grid = np.linspace(lowest.min() - margin, highest.max() + margin, nodes)
    return {
        name: (grid, kde(values, bandwidth=width, grid=grid))
        for name, values, width in zip(
            ("min_foot", "max_foot"), (lowest, highest), widths, strict=True
        )
    }


def _body_curves(
    heights: Sequence[Heights], sections: Sections, nodes: int
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Densities of body height given the state of the feet, on one grid."""
    frames = pool_frames(
        heights,
        min_foot_m=sections.min_foot_threshold_m,
        max_foot_m=sections.max_foot_threshold_m,
        ground_m=sections.ground_m,
        landings_only=sections.landings_only,
    )
    groups = {
        "body_all": frames.body,
        "body_given_all_up": frames.body[frames.all_up],
        "body_given_all_down": frames.body[frames.all_down],
        "body_given_some_down": frames.body[~frames.all_up],
        "body_given_some_up": frames.body[~frames.all_down],
    }
    groups = {name: body for name, body in groups.items() if len(body) > 1 and np.ptp(body) > 0}
    if not groups:
        return {}
    widths = {name: normal_bandwidth(body) for name, body in groups.items()}
    margin = 3 * max(widths.values())
    grid = np.linspace(frames.body.min() - margin, frames.body.max() + margin, nodes)
    return {
        name: (grid, kde(body, bandwidth=widths[name], grid=grid)) for name, body in groups.items()
    }
