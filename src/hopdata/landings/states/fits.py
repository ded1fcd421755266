"""Ways of fitting the tracks of the body markers about a section."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, FloatArray
from hopdata.errors import chosen
from hopdata.landings.states import coefficients
from hopdata.landings.states.tracks import (
    LOOK_AT,
    Moments,
    Windows,
    evenly,
    joined,
    moments,
)

BALLISTIC_WINDOW_S, WINDOW_S = 0.1, 0.06  # default windows of separate fits, for 1 m
NO_LARGER = 1.1  # ratio of rms residuals up to which a few flights count as ballistic
WINDOWS_S = (
    0.03,
    0.04,
    0.05,
    0.06,
    0.08,
    0.1,
    0.12,
    0.15,
    0.18,
    0.22,
)  # tried by `widest`
# Degrees tried before and after the contacts, and the degree of separate fits after
# them.
FLIGHT_DEGREES, STANCE_DEGREES, ALONE_DEGREE = (2, 3), (3, 5), 3
# Fewest frames of a fit, fewest of them close to the crossing, and fewest landings to
# learn from.
LEAST_FRAMES, LEAST_CLOSE, LEAST_LANDINGS = 6, 3, 30
LARGEST_MISFIT = 0.25  # in units of the variance that one more coefficient would cost
FURTHER = 2  # extra coefficients by which a fit is judged
LEAD_QUANTILE = (
    0.1  # quantile of the times between the last contact and the post section
)
FILTER_FRAMES, FILTER_DEGREE = 7, 3

Parts = Iterator[coefficients.Fitted]
#: Makes the fits anew, block by block: for many landings, all at once would fill the
#: memory.
Fit = Callable[[], Parts]


@dataclass(frozen=True)
class Tracks:
    """Body markers and the L crossings of a section before or after the contacts.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    body : (N, B, 3) array
        Body markers in the world, m; NaN where unseen.
    near : (L,) array
        Approximate instants of the crossings, s.
    contact : (L,) array
        Contact beyond which no frame is used, s.
    flight : bool
        Whether the section lies before the contact.
    pace : float
        Pace of the recording: the windows of an animal of 1 m are multiplied by it.
    """

    time: FloatArray
    body: FloatArray
    near: FloatArray
    contact: FloatArray
    flight: bool
    pace: float = 1.0

    @property
    def frame_s(self) -> float:
        """Time between two frames, s."""
        return float(np.median(np.diff(self.time)))

    def evenly(self, count: int) -> Tracks:
        """Return at most `count` of the crossings, evenly spaced."""
        rows = evenly(len(self.near), count)
        return replace(self, near=self.near[rows], contact=self.contact[rows])

    @property
    def lead_s(self) -> float:
        """Time before the post section in which frames count, s; the same for all landings.

        If it were the time since each landing's own last contact, the errors of the
        states would depend on which contact was last, and mimic a map that does. Nine
        in ten landings have at least this much time.
        """
        after = self.near - self.contact
        known = after[np.isfinite(after)]
        return max(float(np.quantile(known, LEAD_QUANTILE)), 0.0) if len(known) else 0.0

    def windows(self, window_s: float) -> Windows:
        """Return windows about the crossings that do not extend beyond the contacts."""
        near, contact = self.near, self.contact
        if self.flight:
            stop = np.searchsorted(self.time, np.minimum(near + window_s, contact))
            start = np.minimum(
                np.searchsorted(self.time, near - window_s), stop - LEAST_FRAMES
            )
        else:
            lead = min(window_s, self.lead_s)
            start = np.searchsorted(self.time, np.maximum(near - lead, contact))
            stop = np.searchsorted(self.time, near + window_s, side="right")
            stop = np.maximum(stop, start + LEAST_FRAMES)
        return Windows(near, start, stop, window_s)

    def sums(
        self, window_s: float, degree: int, *, falling: bool = False
    ) -> Iterator[Moments]:
        """Sum the frames for polynomials of a degree, with free fall subtracted if `falling`."""
        fall, windows = GRAVITY_M_S2 if falling else 0.0, self.windows(window_s)
        return moments(self.time, self.body, windows, degree=degree, gravity_m_s2=fall)

    def fitted(self, window_s: float, degree: int, *, falling: bool = False) -> Fit:
        """Fit polynomials of a degree to each landing by itself."""
        return _each(partial(self.sums, window_s, degree, falling=falling))


def _each(sums: Callable[[], Iterator[Moments]]) -> Fit:
    """Fit each landing by itself, by least squares."""
    variance, _ = coefficients.noise(sums())
    return lambda: (
        (part, coefficients.least_squares(part, variance)) for part in sums()
    )


def filtered(tracks: Tracks) -> Fit:
    """Fit cubics to the seven nearest frames: the filter of Savitzky and Golay (1964)."""
    right = np.clip(np.searchsorted(tracks.time, tracks.near), 1, len(tracks.time) - 1)
    early = tracks.near - tracks.time[right - 1] < tracks.time[right] - tracks.near
    start = right - early - FILTER_FRAMES // 2
    windows = Windows(
        tracks.near, start, start + FILTER_FRAMES, FILTER_FRAMES / 2 * tracks.frame_s
    )
    return _each(
        partial(moments, tracks.time, tracks.body, windows, degree=FILTER_DEGREE)
    )


def ballistic(tracks: Tracks, window_s: float | None) -> Fit:
    """Fit straight lines under gravity to each flight by itself."""
    return tracks.fitted(window_s or BALLISTIC_WINDOW_S * tracks.pace, 1, falling=True)


def accelerated(tracks: Tracks, window_s: float | None) -> Fit:
    """Fit parabolas to each flight by itself."""
    return tracks.fitted(window_s or WINDOW_S * tracks.pace, 2)


def alone(tracks: Tracks, window_s: float | None) -> Fit:
    """Fit each landing by itself, for recordings with too few landings to learn from."""
    if not tracks.flight:
        return tracks.fitted(window_s or WINDOW_S * tracks.pace, ALONE_DEGREE)
    free, straight = accelerated(tracks, window_s), ballistic(tracks, window_s)
    rms = [
        float(np.sqrt(np.mean(next(fit())[1].noise_m ** 2))) for fit in (free, straight)
    ]
    return straight if rms[1] <= NO_LARGER * rms[0] else free


def together(tracks: Tracks, window_s: float | None) -> Fit:
    """Fit all landings at once: close to free fall before the contacts, smooth after them.

    Accelerations and higher derivatives are drawn from a population that is learned
    from the landings (see `hopdata.landings.states.coefficients`). Each degree gets the
    widest window in which it fits. The degree with the smallest expected errors of
    velocities is taken.
    """
    degrees = FLIGHT_DEGREES if tracks.flight else STANCE_DEGREES
    choices = (
        widest(tracks, degrees)
        if window_s is None
        else [(d, window_s) for d in degrees]
    )
    found = (_drawn(tracks, *choice) for choice in choices)
    best = min(filter(None, found), key=lambda each: each[0], default=None)
    return alone(tracks, window_s) if best is None else best[1]


def _drawn(tracks: Tracks, degree: int, window_s: float) -> tuple[float, Fit] | None:
    """Return the expected variance of velocities, m^2/s^2, and the fit; None with few landings."""
    sums = partial(tracks.sums, window_s, degree + FURTHER, falling=tracks.flight)
    variance, frames = coefficients.noise(sums())
    rows = coefficients.teachers(frames, degree + 1)
    if len(rows) < LEAST_LANDINGS:
        return None
    some = joined(
        part.some(np.flatnonzero(np.isin(part.rows, rows))) for part in sums()
    )
    population = coefficients.learn(some.lower(degree))

    def fitted(part: Moments) -> coefficients.Coefficients:
        return coefficients.drawn(
            part.lower(degree), population, least_frames=LEAST_FRAMES
        )

    added, expected = coefficients.misfit(
        (fitted(part), coefficients.least_squares(part, variance)) for part in sums()
    )
    reach = max(WINDOW_S * tracks.pace, LEAST_FRAMES * tracks.frame_s)
    close = (
        np.concatenate([part.frames for part in tracks.sums(reach, 0)]) >= LEAST_CLOSE
    )

    def parts() -> Parts:
        for part in sums():
            fit = fitted(part)
            fit.covariance[coefficients.VARIANCES] += added
            fit.mean[~close[part.rows]] = np.nan
            yield part.lower(degree), fit

    return expected / window_s**2, parts


def widest(tracks: Tracks, degrees: Sequence[int]) -> list[tuple[int, float]]:
    """Return each degree with the widest window, s, in which such polynomials fit the tracks.

    As long as a coefficient reduces the squared residuals by less than noise would, the
    error of omitting it is smaller than that of estimating it (Mallows 1973). A degree
    that fits no window is left out.
    """
    tracks, widths = (
        tracks.evenly(LOOK_AT),
        [width * tracks.pace for width in WINDOWS_S],
    )
    chosen = []
    for degree in degrees:
        misfits = ((width, _misfit(tracks, degree, width)) for width in widths)
        told = ((width, misfit) for width, misfit in misfits if misfit is not None)
        fitting = list(takewhile(lambda one: one[1] <= LARGEST_MISFIT, told))
        if fitting:
            chosen.append((degree, fitting[-1][0]))
    return chosen


def _misfit(tracks: Tracks, degree: int, window_s: float) -> float | None:
    """Return the variance that the next coefficients explain beyond noise, in noise variances.

    It is the larger of the horizontal and the vertical value, minus twice its standard
    error; None if too few landings have enough frames.
    """
    more = joined(tracks.sums(window_s, degree + FURTHER, falling=tracks.flight))
    whole = np.flatnonzero((more.frames > more.terms).all(axis=1))
    if len(whole) < LEAST_LANDINGS:
        return None
    more = more.some(whole)
    both = more, more.lower(degree)
    noise, left = (coefficients.least_squares(sums).noise_m ** 2 for sums in both)
    freedom = float(more.frames.mean()) - more.terms
    found = []
    for axes in (coefficients.HORIZONTAL, coefficients.VERTICAL):
        ratio = float(left[:, axes].sum() / noise[:, axes].sum())
        scatter = (2 * FURTHER + 2 * FURTHER**2 / freedom) / (
            len(whole) * left[:, axes].size
        )
        found.append((ratio - 1) * (freedom + FURTHER) - 2 * float(np.sqrt(scatter)))
    return max(found)


# Positions and velocities of the body markers where the body crosses a section.

Fitting = Callable[[Tracks, float | None], Fit]

GRAVITIES: dict[str, Fitting | None] = {
    "auto": None,
    "known": ballistic,
    "free": accelerated,
}
SIDES = {"before": True, "after": False}  # whether the section lies in flight


def section_states(
    time: FloatArray,
    body: FloatArray,
    near: FloatArray,
    *,
    height_m: float,
    side: str,
    contact: FloatArray,
    method: str = "split_fit",
    window_s: float | None = None,
    gravity: str = "auto",
    pace: float = 1.0,
) -> coefficients.SectionStates:
    """Fit the motion of each marker about each crossing and evaluate it on the section.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    body : (N, B, 3) array
        Body markers in the world, z up, m; NaN where unseen.
    near : (L,) array
        Approximate instants of the crossings, s.
    height_m : float
        Height of the section, m.
    side : {"before", "after"}
        Side of the contacts on which the section lies.
    contact : (L,) array
        First contact for the pre section, last contact for the post section, s. The
        split fit uses no frames beyond it.
    method : {"split_fit", "savitzky_golay"}
        Polynomials over a window on the section's side of the contacts, or a cubic over
        the seven nearest frames, whether or not a contact lies among them.
    window_s : float, optional
        Time on either side of the crossing whose frames the split fit uses, s; on the
        side away from the contacts it is widened until there are enough frames. By
        default it is as wide as polynomials fit (see
        `hopdata.landings.states.fits.widest`).
    gravity : {"auto", "known", "free"}
        Model of the flight before the contacts: straight lines under gravity (`known`),
        or an acceleration of its own for each marker and landing (`free`). `auto`
        learns from all landings how much accelerations differ from gravity. With few
        landings it uses gravity if that does not increase the residuals.
    pace : float
        Pace of the recording (`hopdata.recording.Recording.pace`).

    Returns
    -------
    SectionStates

    Raises
    ------
    ConfigError
        If `method`, `gravity` or `side` is unknown.
    """
    fitted = chosen("states.method", method, METHODS)
    flying = chosen("states.gravity", gravity, GRAVITIES)
    tracks = Tracks(time, body, near, contact, chosen("side", side, SIDES), pace)
    return coefficients.cross(fitted(tracks, window_s, flying)(), near, height_m)


def _split_fit(tracks: Tracks, window_s: float | None, flying: Fitting | None) -> Fit:
    if tracks.flight and flying is not None:
        return flying(tracks, window_s)
    return (together if len(tracks.near) >= LEAST_LANDINGS else alone)(tracks, window_s)


METHODS = {
    "split_fit": _split_fit,
    "savitzky_golay": lambda tracks, *_: filtered(tracks),
}
