"""The printed method: contact at the minimum of a foot's velocity in the transition."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.errors import AnalysisError
from hopdata.landings.contacts.descents import Transitions
from hopdata.recording import Recording

#: Window of the filter: seven frames at the dissertation's 100 Hz.
#: Unit: s. Origin: table: Algorithm 4 of the dissertation; Sec. 2.2.3 prints none.
FILTER_S = 0.07

#: Fewest frames in the window: the least odd number that a cubic smooths.
#: Unit: frames. Origin: chosen.
LEAST_FILTER_FRAMES = 5

#: Time shown before the pre section and after the post section; it moves no answer.
#: Unit: s. Origin: chosen.
MARGIN_S = 0.05


def filter_window(rate_hz: float) -> int:
    """Return the odd number of frames nearest to the dissertation's window of 0.07 s.

    Seven frames last 0.07 s only at 100 Hz; at 2000 Hz they would give nothing but
    noise.

    >>> [filter_window(rate) for rate in (50.0, 100.0, 120.0, 500.0)]
    [5, 7, 9, 35]
    """
    half = int(rate_hz * FILTER_S / 2)
    return max(2 * half + 1, LEAST_FILTER_FRAMES)


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
    if not window:
        window = filter_window(rate_hz)
    half = window // 2
    weights = derivative_weights(window)
    n_inner = len(values) - 2 * half
    velocity = np.full(values.shape, np.nan)
    if n_inner <= 0:
        return velocity
    for track, into in zip(values.T, velocity.T, strict=True):
        into[half : half + n_inner] = sum(
            weight * track[k : k + n_inner] for k, weight in enumerate(weights)
        )
    velocity *= rate_hz
    return velocity


def derivative_weights(window: int) -> FloatArray:
    """Return the weights (window,) of samples in the cubic's slope there, per frame.

    The slope is that at mid-window. The weights come from sums of integers, since a
    solver's last digits depend on its version and on the machine.
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
    """Find the minimum of each foot's vertical velocity between the two sections.

    See Sec. 2.2.3 of the dissertation. Smoothing moves the minimum ahead of the
    contact, by the same time for all feet to the extent that they are alike. A velocity
    that is smallest at an end of the transition and still falls beyond it has its
    minimum outside: it is followed there, so that the touchdown can be excluded.

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
    instant = np.full(shape, np.nan)
    se = np.full(shape, np.nan)
    # Noise of half the difference between the velocities one frame to either side.
    weights = derivative_weights(filter_window(1 / frame_s))
    half_difference = np.convolve(weights, [0.5, 0.0, -0.5])
    noise = noise_m / frame_s * float(np.linalg.norm(half_difference))
    first = np.searchsorted(time, transitions.t_pre)
    stop = np.searchsorted(time, transitions.t_post, side="right")
    for row in np.flatnonzero(transitions.complete):
        for foot in range(shape[1]):
            piece = velocity[first[row] : stop[row], foot]
            if len(piece) == 0 or np.isnan(piece).any():
                continue
            least = int(first[row] + np.argmin(piece))
            least = _followed(velocity[:, foot], least)
            instant[row, foot] = time[least]
            se[row, foot] = frame_s / np.sqrt(12)  # of rounding to a frame
            around = velocity[least - 1 : least + 2, foot]
            if not parabola or len(around) < 3:
                continue
            bend = around[0] - 2 * around[1] + around[2]
            if bend > 0:
                instant[row, foot] += frame_s * (around[0] - around[2]) / (2 * bend)
                se[row, foot] = frame_s * noise / bend
    return instant, se


def _followed(velocity: FloatArray, frame: int) -> int:
    """Return the frame of the minimum to which a velocity (N,) falls from a frame."""
    for step in (-1, 1):
        following = frame + step
        # Comparisons with NaN are false: where nothing is seen, the search ends.
        while 0 <= following < len(velocity) and velocity[following] < velocity[frame]:
            frame = following
            following += step
    return frame


# One typical touchdown to show.


def example_touchdown(
    recordings: Sequence[Recording], table: pd.DataFrame
) -> pd.DataFrame:
    """Tabulate heights and velocities of the feet in one typical touchdown (Fig. 2.3).

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled, with different names.
    table : pandas.DataFrame
        Their touchdowns.

    Returns
    -------
    pandas.DataFrame
        recording, touchdown, time_s (from the pre section), foot, height_m,
        velocity_m_s (by the filter of the printed method). Among the touchdowns with
        the most common schedule, those at least as sure as the median are kept, and the
        one with the median spread is taken.

    Raises
    ------
    AnalysisError
        If no touchdown is used.
    """
    row = _typical(table)
    recording = next(r for r in recordings if r.name == row["recording"])
    time = recording.time
    feet = recording.names("foot")
    begin_s = row["t_pre_s"] - MARGIN_S
    end_s = row["t_post_s"] + MARGIN_S
    shown = np.flatnonzero((time >= begin_s) & (time <= end_s))
    heights = recording.feet[:, :, 2]
    rate_hz = 1 / float(np.median(np.diff(time)))
    reach = filter_window(rate_hz)
    about = slice(max(shown[0] - reach, 0), shown[-1] + reach + 1)
    velocity = np.full(heights.shape, np.nan)
    velocity[about] = savitzky_golay_velocity(heights[about], rate_hz)
    columns = {
        "recording": recording.name,
        "touchdown": int(row["touchdown"]),
        "time_s": np.tile(time[shown] - row["t_pre_s"], len(feet)),
        "foot": np.repeat(feet, len(shown)),
        "height_m": heights[shown].T.ravel(),
        "velocity_m_s": velocity[shown].T.ravel(),
    }
    return pd.DataFrame(columns)


def _typical(table: pd.DataFrame) -> pd.Series:
    """Return the touchdown to show: see `example_touchdown`."""
    used = table[~table["excluded"].astype(bool)]
    if used.empty:
        raise AnalysisError(
            "touchdowns: expected at least one usable one to show, found none"
        )
    counts = used["schedule"].value_counts(sort=False)
    commonest = min(counts.index[counts == counts.max()])
    alike = used[used["schedule"] == commonest]
    sure = alike[alike["probability"] >= alike["probability"].median()]
    if sure.empty:
        sure = alike
    ranked = sure.sort_values(["spread_s", "recording", "touchdown"])
    return ranked.iloc[(len(ranked) - 1) // 2]
