"""Ways of fitting the tracks of the body markers about a section."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, BoolArray, FloatArray, IntArray
from hopdata.errors import chosen
from hopdata.landings.states import coefficients
from hopdata.landings.states.crossing import (
    Fitted,
    InstantStates,
    SectionStates,
    at_instants,
    cross,
)
from hopdata.landings.states.tracks import (
    LOOK_AT,
    Moments,
    Windows,
    evenly,
    joined,
    kept,
    moments,
)

#: Window of separate fits under gravity, for an animal of 1 m.
#: Unit: s. Origin: chosen.
BALLISTIC_WINDOW_S = 0.1

#: Window of other separate fits, for an animal of 1 m.
#: Unit: s. Origin: chosen.
WINDOW_S = 0.06

#: Ratio of the rms residuals of straight flights to those of curved ones up to which a
#: few flights count as ballistic.
#: Unit: 1. Origin: chosen.
NO_LARGER = 1.1

#: Windows that `widest` tries, for an animal of 1 m. The shortest are for stiff robots
#: at high rates, whose tracks no longer window fits.
#: Unit: s. Origin: chosen.
WINDOWS_S = (0.03, 0.04, 0.05, 0.06, 0.08, 0.1, 0.12, 0.15, 0.18, 0.22)

#: Degrees of polynomials tried before the contacts.
#: Unit: 1. Origin: chosen.
FLIGHT_DEGREES = (2, 3)

#: Degrees of polynomials tried after the contacts.
#: Unit: 1. Origin: chosen.
STANCE_DEGREES = (3, 5)

#: Degree of separate fits after the contacts, and of swinging legs.
#: Unit: 1. Origin: chosen.
ALONE_DEGREE = 3

#: Fewest frames of a fit.
#: Unit: frames. Origin: chosen.
LEAST_FRAMES = 6

#: Fewest frames of a marker close to the crossing; with fewer, the state is not
#: determined.
#: Unit: frames. Origin: chosen.
LEAST_CLOSE = 3

#: Fewest landings from which accelerations are learned; with fewer, each is fitted by
#: itself.
#: Unit: landings. Origin: chosen.
LEAST_LANDINGS = 30

#: Largest misfit of a window, in units of the variance that one more coefficient would
#: cost.
#: Unit: 1. Origin: chosen.
LARGEST_MISFIT = 0.25

#: Squared residuals, in usual ones, beyond which a landing teaches the others nothing:
#: five standard deviations. In one landing of 500 the body was held, and the fits of
#: all others got shorter windows.
#: Unit: 1. Origin: chosen.
OUTLYING = 25.0

#: Extra coefficients by which a fit is judged.
#: Unit: 1. Origin: chosen.
FURTHER = 2

#: Quantile of the times from the last contact to the post section that is the lead of
#: all landings.
#: Unit: 1. Origin: chosen.
LEAD_QUANTILE = 0.1

# The filter of the dissertation: a cubic over seven frames.
FILTER_FRAMES = 7
FILTER_DEGREE = 3

Parts = Iterator[Fitted]
# Makes the fits anew, block by block: for many landings, all at once would fill the
# memory.
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
    time_scale : float
        Time scale of the recording, by which windows for an animal of 1 m are
        multiplied.
    direction : (L, 2) array, optional
        x axes of the landings' frames; by default they follow from the markers.
    """

    time: FloatArray
    body: FloatArray
    near: FloatArray
    contact: FloatArray
    flight: bool
    time_scale: float = 1.0
    direction: FloatArray | None = None

    @property
    def frame_s(self) -> float:
        """Time between two frames, s."""
        return float(np.median(np.diff(self.time)))

    def evenly(self, count: int) -> Tracks:
        """Return at most `count` of the crossings, evenly spaced."""
        return self.some(evenly(len(self.near), count))

    def some(self, rows: IntArray) -> Tracks:
        """Return the crossings of these numbers."""
        direction = self.direction
        if direction is not None:
            direction = direction[rows]
        return replace(
            self,
            near=self.near[rows],
            contact=self.contact[rows],
            direction=direction,
        )

    @property
    def lead_s(self) -> float:
        """Time before the post section in which frames count, s, for all landings.

        If it were the time since each landing's own last contact, the errors of the
        states would depend on which contact was last, and mimic a map that does. Nine
        in ten landings have at least this much time.
        """
        after = self.near - self.contact
        known = after[np.isfinite(after)]
        if not len(known):
            return 0.0
        return max(float(np.quantile(known, LEAD_QUANTILE)), 0.0)

    def windows(self, window_s: float) -> Windows:
        """Return windows about the crossings that do not extend beyond the contacts."""
        near = self.near
        if self.flight:
            latest = np.minimum(near + window_s, self.contact)
            stop = np.searchsorted(self.time, latest)
            start = np.searchsorted(self.time, near - window_s)
            start = np.minimum(start, stop - LEAST_FRAMES)
        else:
            lead_s = min(window_s, self.lead_s)
            earliest = np.maximum(near - lead_s, self.contact)
            start = np.searchsorted(self.time, earliest)
            stop = np.searchsorted(self.time, near + window_s, side="right")
            stop = np.maximum(stop, start + LEAST_FRAMES)
        return Windows(near, start, stop, window_s, self.direction)

    def sums(
        self, window_s: float, degree: int, *, falling: bool = False
    ) -> Iterator[Moments]:
        """Sum the frames for polynomials of a degree.

        Free fall is subtracted if the markers are `falling`.
        """
        return moments(
            self.time,
            self.body,
            self.windows(window_s),
            degree=degree,
            gravity_m_s2=GRAVITY_M_S2 if falling else 0.0,
        )

    def fitted(self, window_s: float, degree: int, *, falling: bool = False) -> Fit:
        """Fit polynomials of a degree to each landing by itself."""
        return _each(partial(self.sums, window_s, degree, falling=falling))


def _each(sums: Callable[[], Iterator[Moments]]) -> Fit:
    """Fit each landing by itself, by least squares."""
    sums = kept(sums)
    variance, _ = coefficients.noise(sums())

    def parts() -> Parts:
        for part in sums():
            yield part, coefficients.least_squares(part, variance)

    return parts


def filtered(tracks: Tracks) -> Fit:
    """Fit cubics to the seven nearest frames, as Savitzky and Golay (1964) do."""
    time = tracks.time
    right = np.clip(np.searchsorted(time, tracks.near), 1, len(time) - 1)
    left_is_nearer = tracks.near - time[right - 1] < time[right] - tracks.near
    nearest = right - left_is_nearer
    start = nearest - FILTER_FRAMES // 2
    half_window_s = FILTER_FRAMES / 2 * tracks.frame_s
    windows = Windows(tracks.near, start, start + FILTER_FRAMES, half_window_s)
    return _each(partial(moments, time, tracks.body, windows, degree=FILTER_DEGREE))


def ballistic(tracks: Tracks, window_s: float | None) -> Fit:
    """Fit straight lines under gravity to each flight by itself."""
    if not window_s:
        window_s = BALLISTIC_WINDOW_S * tracks.time_scale
    return tracks.fitted(window_s, 1, falling=True)


def accelerated(tracks: Tracks, window_s: float | None) -> Fit:
    """Fit parabolas to each flight by itself."""
    return tracks.fitted(window_s or WINDOW_S * tracks.time_scale, 2)


def alone(tracks: Tracks, window_s: float | None) -> Fit:
    """Fit each landing by itself, as where there are too few landings to learn from."""
    if not tracks.flight:
        return tracks.fitted(window_s or WINDOW_S * tracks.time_scale, ALONE_DEGREE)
    return straight_or(accelerated(tracks, window_s), tracks, window_s)


def straight_or(free: Fit, tracks: Tracks, window_s: float | None) -> Fit:
    """Return straight lines under gravity, or a freer fit if it fits far better."""
    straight = ballistic(tracks, window_s)
    if _rms_residual(straight) <= NO_LARGER * _rms_residual(free):
        return straight
    return free


def _rms_residual(fit: Fit) -> float:
    """Return the rms of the noise over markers and directions, m."""
    _, first_block = next(fit())  # the noise is that of all blocks
    return float(np.sqrt(np.mean(first_block.noise_m**2)))


def together(tracks: Tracks, window_s: float | None) -> Fit:
    """Fit all landings at once: close to free fall before contacts, smooth after them.

    Accelerations and higher derivatives are drawn from a population that is learned
    from the landings (see `hopdata.landings.states.coefficients`). Each degree gets the
    widest window in which it fits. The degree with the smallest expected errors of
    velocities is taken.
    """
    degrees = FLIGHT_DEGREES if tracks.flight else STANCE_DEGREES
    if window_s is None:
        candidates = widest(tracks, degrees)
    else:
        candidates = [(degree, window_s) for degree in degrees]
    best: Fit | None = None
    least_variance = np.inf
    for degree, width_s in candidates:
        found = _drawn(tracks, degree, width_s)
        if found is None:
            continue
        variance, fit = found
        if best is None or variance < least_variance:
            least_variance = variance
            best = fit
    if best is None:
        return alone(tracks, window_s)
    return best


def _drawn(tracks: Tracks, degree: int, window_s: float) -> tuple[float, Fit] | None:
    """Fit polynomials whose higher coefficients are drawn from a learned population.

    Return the expected variance of velocities, m^2/s^2, and the fit; None with too few
    landings to learn from.
    """
    sums = kept(partial(tracks.sums, window_s, degree + FURTHER, falling=tracks.flight))
    # The higher degree tells a landing whose frames follow no smooth motion.
    is_usual = _usual([coefficients.residual_squares(part) for part in sums()])

    def usual_sums() -> Iterator[Moments]:
        for part in sums():
            yield part.some(np.flatnonzero(is_usual[part.rows]))

    variance, _ = coefficients.noise(usual_sums())
    frames = np.concatenate([part.frames for part in sums()])
    rows = coefficients.landings_to_learn_from(
        np.where(is_usual[:, None], frames, 0.0), degree + 1
    )
    if len(rows) < LEAST_LANDINGS:
        return None
    teaching = joined(
        part.some(np.flatnonzero(np.isin(part.rows, rows))) for part in sums()
    )
    population = coefficients.learn_population(teaching.lower(degree))

    def fitted(part: Moments) -> coefficients.Coefficients:
        return coefficients.fit_with_population(
            part.lower(degree), population, least_frames=LEAST_FRAMES
        )

    added, expected = coefficients.misfit(
        (fitted(part), coefficients.least_squares(part, variance))
        for part in usual_sums()
    )
    close_s = max(WINDOW_S * tracks.time_scale, LEAST_FRAMES * tracks.frame_s)
    close_frames = np.concatenate([part.frames for part in tracks.sums(close_s, 0)])
    is_close = close_frames >= LEAST_CLOSE

    def parts() -> Parts:
        for part in sums():
            fit = fitted(part)
            fit.covariance[coefficients.VARIANCES] += added
            fit.mean[~is_close[part.rows]] = np.nan
            odd = np.flatnonzero(~is_usual[part.rows])
            if len(odd):
                _fit_closely(fit, part, odd, tracks, window_s)
            yield part.lower(degree), fit

    return expected / window_s**2, parts


def _fit_closely(
    fit: coefficients.Coefficients,
    part: Moments,
    odd: IntArray,
    tracks: Tracks,
    window_s: float,
) -> None:
    """Replace the coefficients of odd landings by those of frames near the crossing.

    The wide window of all others holds frames there that follow another motion, such
    as those of the stance before a short flight. Coefficients of a narrower window are
    brought to the unit of time of the wide one.

    Parameters
    ----------
    fit, part
        Fit of a block of landings, and its sums.
    odd
        Which of the block's landings these are.
    tracks, window_s
        All landings, and the wide window, s.
    """
    close_s = min(WINDOW_S * tracks.time_scale, window_s)
    terms = fit.mean.shape[-1]
    degree = min(terms - 1, 2 if tracks.flight else ALONE_DEGREE)
    few = tracks.some(part.rows[odd])
    few = replace(few, direction=part.direction[odd])
    wider = (window_s / close_s) ** np.arange(degree + 1)
    sums = joined(few.sums(close_s, degree, falling=tracks.flight))
    close = coefficients.least_squares(sums, fit.noise_m**2)
    is_known = np.isfinite(fit.mean[odd])
    mean = np.zeros(fit.mean[odd].shape)
    mean[..., : degree + 1] = close.mean * wider
    mean[..., 0] += sums.centre - part.centre[odd]
    covariance = np.zeros(fit.covariance[odd].shape)
    covariance[..., : degree + 1, : degree + 1] = (
        close.covariance * wider[:, None] * wider
    )
    fit.mean[odd] = np.where(is_known, mean, np.nan)
    fit.covariance[odd] = covariance


def _usual(residual_squares: Sequence[FloatArray]) -> BoolArray:
    """Mark the landings (L,), given block by block, whose residuals are not far off."""
    squares = np.concatenate(residual_squares)
    known = squares[np.isfinite(squares)]
    if not len(known):
        return np.ones(len(squares), dtype=bool)
    return np.asarray(~(squares > OUTLYING * np.median(known)))


def widest(tracks: Tracks, degrees: Sequence[int]) -> list[tuple[int, float]]:
    """Return each degree with the widest window, s, in which it fits the tracks.

    As long as a coefficient reduces the squared residuals by less than noise would, the
    error of omitting it is smaller than that of estimating it (Mallows 1973). A degree
    that fits no window is left out.
    """
    some = tracks.evenly(LOOK_AT)
    found = []
    for degree in degrees:
        widest_s = None
        for width in WINDOWS_S:
            window_s = width * tracks.time_scale
            misfit = _misfit(some, degree, window_s)
            if misfit is None:  # too few frames; a wider window may hold enough
                continue
            if misfit > LARGEST_MISFIT:
                break
            widest_s = window_s
        if widest_s is not None:
            found.append((degree, widest_s))
    return found


def _misfit(tracks: Tracks, degree: int, window_s: float) -> float | None:
    """Return the variance that further coefficients explain beyond noise.

    It is in noise variances: the larger of the horizontal and the vertical value, minus
    twice its standard error; None if too few landings have enough frames.
    """
    more = joined(tracks.sums(window_s, degree + FURTHER, falling=tracks.flight))
    has_enough = (more.frames > more.terms).all(axis=1)
    is_usual = _usual([coefficients.residual_squares(more)])
    whole = np.flatnonzero(has_enough & is_usual)
    if len(whole) < LEAST_LANDINGS:
        return None
    more = more.some(whole)
    noise, _ = coefficients.noise([more])
    residual, _ = coefficients.noise([more.lower(degree)])
    freedom = float(more.frames.mean()) - more.terms
    found = []
    for axes in (coefficients.HORIZONTAL, coefficients.VERTICAL):
        ratio = float(residual[:, axes].sum() / noise[:, axes].sum())
        tracks_seen = len(whole) * residual[:, axes].size
        variance = (2 * FURTHER + 2 * FURTHER**2 / freedom) / tracks_seen
        explained = (ratio - 1) * (freedom + FURTHER)
        found.append(explained - 2 * float(np.sqrt(variance)))
    return max(found)


# Positions and velocities of the body markers where the body crosses a section.

Fitting = Callable[[Tracks, float | None], Fit]

GRAVITIES: dict[str, Fitting | None] = {
    "auto": None,
    "known": ballistic,
    "free": accelerated,
}
SIDES = {"before": True, "after": False}  # whether the section lies in flight


def section_states(  # noqa: PLR0913 (the data, and the options of the method)
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
    time_scale: float = 1.0,
) -> SectionStates:
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
    time_scale : float
        Time scale of the recording (`hopdata.recording.Recording.time_scale`).

    Returns
    -------
    SectionStates

    Raises
    ------
    ConfigError
        If `method`, `gravity` or `side` is unknown.
    """
    fit_tracks = chosen("states.method", method, METHODS)
    fit_flight = chosen("states.gravity", gravity, GRAVITIES)
    is_flight = chosen("side", side, SIDES)
    tracks = Tracks(time, body, near, contact, is_flight, time_scale)
    fit = fit_tracks(tracks, window_s, fit_flight)
    return cross(fit(), near, height_m)


def states_in_flight(
    time: FloatArray,
    markers: FloatArray,
    near: FloatArray,
    *,
    contact: FloatArray,
    direction: FloatArray,
    window_s: float | None = None,
    time_scale: float = 1.0,
) -> InstantStates:
    """Fit the motion of markers in flight about given instants by the split fit.

    Unlike those of a rigid body, the markers need not be in free fall.

    Parameters
    ----------
    time, markers, near, contact, window_s, time_scale
        See `section_states`; `markers` (N, B, 3), m, need not be on the body.
    direction : (L, 2) array
        x axes of frames, turned about the vertical, in which the markers move much
        alike in all landings.
    """
    tracks = Tracks(time, markers, near, contact, True, time_scale, direction)
    if len(near) >= LEAST_LANDINGS:
        fit = together(tracks, window_s)
    else:
        # A swinging leg's acceleration changes within the window. Within it, a cubic
        # is hardly less sure than a parabola.
        cubics = tracks.fitted(window_s or WINDOW_S * time_scale, ALONE_DEGREE)
        fit = straight_or(cubics, tracks, window_s)
    return at_instants(fit())


def _split_fit(
    tracks: Tracks, window_s: float | None, fit_flight: Fitting | None
) -> Fit:
    if tracks.flight and fit_flight is not None:
        return fit_flight(tracks, window_s)
    if len(tracks.near) >= LEAST_LANDINGS:
        return together(tracks, window_s)
    return alone(tracks, window_s)


METHODS = {
    "split_fit": _split_fit,
    "savitzky_golay": lambda tracks, *_: filtered(tracks),
}
