"""What a package of your own may bring: a reader, a scene, a method and a figure."""

from dataclasses import dataclass

import numpy as np

from hopdata.recordings.raw import RawRecording
from hopdata.scenes.quadruped import Quadruped


def read_npz(path, rate_hz):
    """Read ``time`` (N,), s, ``positions`` (N, M, 3), m, and ``markers`` (M,)."""
    with np.load(path, allow_pickle=False) as archive:
        time, places = archive["time"], archive["positions"]
        markers = tuple(str(name) for name in archive["markers"])
    rate_hz = rate_hz or 1 / float(np.median(np.diff(time)))
    return RawRecording(markers, time, places, rate_hz, "m")


@dataclass(frozen=True)
class StiffQuadruped(Quadruped):
    """The quadruped on legs that are stiffer aside by half."""

    side_stiffness_n_m: float = 90.0


def lowest_speed(time, heights, transitions, *, noise_m):
    """Take the frame in which each foot sinks fastest for its contact.

    Instants and their standard errors are (L, n), s, for L descents and n feet.
    """
    frame_s = float(np.median(np.diff(time)))
    speed = np.gradient(heights, frame_s, axis=0)
    shape = (len(transitions), heights.shape[1])
    instants = np.full(shape, np.nan)
    for row, (begin_s, end_s) in enumerate(
        zip(transitions.t_pre, transitions.t_post, strict=True)
    ):
        frames = np.flatnonzero((time >= begin_s) & (time <= end_s))
        if len(frames) and np.isfinite(speed[frames]).all():
            instants[row] = time[frames[speed[frames].argmin(axis=0)]]
    # An instant is rounded to a frame.
    errors = np.where(np.isfinite(instants), frame_s / np.sqrt(12), np.nan)
    return instants, errors


def spreads_figure(touchdowns):
    """Draw how far apart the contacts of the landings are."""
    from matplotlib.figure import Figure

    figure = Figure()
    axes = figure.subplots()
    axes.hist(1e3 * touchdowns["spread_s"].dropna(), bins=30)
    axes.set_xlabel("from the first contact to the last (ms)")
    axes.set_ylabel("landings")
    return figure


spreads_figure.files = ("tables/touchdowns.csv",)
