"""A way to find the instant at which each foot touched."""

import numpy as np


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
