"""The printed method: contact at the minimum of a foot's vertical velocity in the transition."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.errors import AnalysisError
from hopdata.landings.contacts.descents import Transitions
from hopdata.recording import Recording

FILTER_S = 0.07  # seven frames at the dissertation's 100 Hz
LEAST_FILTER_FRAMES = 5
MARGIN_S = 0.05  # time shown before the pre section and after the post section


def filter_window(rate_hz: float) -> int:
    """Return the odd number of frames nearest to the dissertation's window of 0.07 s.

    Seven frames last 0.07 s only at 100 Hz; at 2000 Hz they would give nothing but
    noise.

    >>> [filter_window(rate) for rate in (50.0, 100.0, 120.0, 500.0)]
    [5, 7, 9, 35]
    """
    return max(2 * int(rate_hz * FILTER_S / 2) + 1, LEAST_FILTER_FRAMES)


def savitzky_golay_velocity(
    values: FloatArray, rate_hz: float, *, window: int | None = None
) -> FloatArray:
    """Differentiate by a cubic fitted to a moving window.

    Parameters
    ----------
    values : (N, n) array
        Samples at a constant rate; NaN where unseen.
    rate_hz : float
        Frame rate, Hz.
    window : int, optional
        Odd number of frames in the window, by default `filter_window`.

    Returns
    -------
    (N, n) array
        Derivative in units of `values` per second; NaN where the window is not
        complete.
    """
    window = window or filter_window(rate_hz)
    half, weights = window // 2, derivative_weights(window)
    out, inner = np.full(values.shape, np.nan), len(values) - 2 * half
    for each, into in zip(values.T, out.T, strict=True) if inner > 0 else ():
        into[half : half + inner] = sum(
            w * each[k : k + inner] for k, w in enumerate(weights)
        )
    out *= rate_hz
    return out


def derivative_weights(window: int) -> FloatArray:
    """Return the weights (window,) of the samples in the cubic's slope at mid-window, per frame.

    The weights come from sums of integers, since a solver's last digits depend on its
    version and on the machine.
    """
    frames = np.arange(window) - window // 2
    s2, s4, s6 = (float(np.sum(frames**power)) for power in (2, 4, 6))
    return (s6 * frames - s4 * frames**3) / (s2 * s6 - s4 * s4)


def velocity_minima(
    time: FloatArray,
    heights: FloatArray,
    transitions: Transitions,
    noise_m: float,
    parabola: bool,
) -> tuple[FloatArray, FloatArray]:
    """Find the instant of minimum vertical velocity of each foot between the two sections.

    See Sec. 2.2.3 of the dissertation. Smoothing moves the minimum ahead of the
    contact, by the same time for all feet to the extent that they are alike.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    heights : (N, n) array
        Heights of the feet, m; NaN where unseen.
    transitions : Transitions
        L descents of the body.
    noise_m : float
        Standard deviation of a height, m.
    parabola : bool
        Take the vertex of the parabola through the minimum frame and its two neighbours
        instead of the frame itself.

    Returns
    -------
    instant, se : (L, n) array
        Instants and standard errors, s; NaN where the transition is incomplete or a
        frame of the filter's window is missing in it. The error is that of rounding to
        a frame, or of the vertex due to the noise of the heights. The actual scatter is
        larger: several times this error at 1000 Hz, where noise decides which frame is
        the minimum, and larger for a vertex too, since its place depends on where
        within a frame the contact falls.
    """
    frame_s = float(np.median(np.diff(time)))
    velocity = savitzky_golay_velocity(heights, 1 / frame_s)
    shape = (len(transitions), heights.shape[1])
    instant, se = np.full(shape, np.nan), np.full(shape, np.nan)
    # Noise of half the difference between the velocities one frame to either side.
    weights = np.convolve(
        derivative_weights(filter_window(1 / frame_s)), [0.5, 0.0, -0.5]
    )
    noise = noise_m / frame_s * float(np.linalg.norm(weights))
    first = np.searchsorted(time, transitions.t_pre)
    stop = np.searchsorted(time, transitions.t_post, side="right")
    for row in np.flatnonzero(transitions.complete):
        for foot in range(shape[1]):
            piece = velocity[first[row] : stop[row], foot]
            if len(piece) == 0 or np.isnan(piece).any():
                continue
            least = int(first[row] + np.argmin(piece))
            instant[row, foot], se[row, foot] = time[least], frame_s / np.sqrt(12)
            around = velocity[least - 1 : least + 2, foot]
            bend = around[0] - 2 * around[1] + around[2] if len(around) == 3 else np.nan
            if parabola and bend > 0:
                instant[row, foot] += frame_s * (around[0] - around[2]) / (2 * bend)
                se[row, foot] = frame_s * noise / bend
    return instant, se


# One typical touchdown to show.


def example_touchdown(
    recordings: Sequence[Recording], table: pd.DataFrame
) -> pd.DataFrame:
    """Tabulate the heights and velocities of the feet in one typical touchdown (Fig. 2.3).

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled, with different names.
    table : pandas.DataFrame
        Their touchdowns.

    Returns
    -------
    pandas.DataFrame
        recording, index, time_s (from the pre section), foot, height_m, velocity_m_s
        (by the filter of the printed method). Among the touchdowns with the most common
        schedule, those at least as sure as the median are kept, and the one with the
        median spread is taken.

    Raises
    ------
    AnalysisError
        If no touchdown is used.
    """
    used = table[~table["excluded"].astype(bool)]
    if used.empty:
        raise AnalysisError(
            "touchdowns: expected at least one usable one to show, found none"
        )
    counts = used["schedule"].value_counts(sort=False)
    commonest = min(counts.index[counts == counts.max()])
    alike = used[used["schedule"] == commonest]
    sure = alike[alike["probability"] >= alike["probability"].median()]
    ranked = (alike if sure.empty else sure).sort_values(
        ["spread_s", "recording", "index"]
    )
    row = ranked.iloc[(len(ranked) - 1) // 2]
    recording = next(r for r in recordings if r.name == row["recording"])
    time, feet = recording.time, recording.names("foot")
    frames = (time >= row["t_pre_s"] - MARGIN_S) & (time <= row["t_post_s"] + MARGIN_S)
    heights = recording.feet[:, :, 2]
    rate_hz = 1 / float(np.median(np.diff(time)))
    reach, shown = filter_window(rate_hz), np.flatnonzero(frames)
    about = slice(max(shown[0] - reach, 0), shown[-1] + reach + 1)
    velocity = np.full(heights.shape, np.nan)
    velocity[about] = savitzky_golay_velocity(heights[about], rate_hz)
    columns = {
        "recording": recording.name,
        "index": int(row["index"]),
        "time_s": np.tile(time[frames] - row["t_pre_s"], len(feet)),
        "foot": np.repeat(feet, len(shown)),
        "height_m": heights[frames].T.ravel(),
        "velocity_m_s": velocity[frames].T.ravel(),
    }
    return pd.DataFrame(columns)
