"""Processing of positions before they were written: resampling or smoothing."""

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.messages import Message
from hopdata.recordings.quality.rigid import frame_noise
from hopdata.recordings.quality.stretches import quantiles

#: Frames in the middle of a recording from which its processing is inferred.
#: Unit: frames. Origin: chosen.
SPECTRUM_FRAMES = 2**14

#: Frames of a segment whose spectrum is averaged with those of the others.
#: Unit: frames. Origin: chosen.
SEGMENT = 256

#: Lowest frequency of a pattern that resampling leaves; slower ones may be the animal's
#: own motion.
#: Unit: cycles a frame. Origin: chosen.
QUICKEST = 0.09

#: Least share of the variance that a pattern makes.
#: Unit: 1. Origin: chosen.
PATTERN_SHARE = 0.15

#: Least power of a pattern, relative to the usual power of frequencies nearby.
#: Unit: 1. Origin: chosen.
PATTERN_PEAK = 60.0

#: Largest roughness of a frame that counts, relative to the usual one: contacts are
#: rougher still.
#: Unit: 1. Origin: chosen.
ROUGHEST = 3.0

#: Roughness that a copied frame counts for.
#: Unit: 1. Origin: chosen.
COPY = 3.0

#: Least frame-to-frame noise of any camera, for an animal of 1 m.
#: Unit: m. Origin: chosen.
NO_CAMERA_M = 2e-5

#: Power, relative to the floor that rounding makes, from which on a frequency counts.
#: Unit: 1. Origin: chosen.
ABOVE_FLOOR = 30.0

#: Frequency from which on only the rounding floor is left.
#: Unit: cycles a frame. Origin: chosen.
FLOOR_FROM = 0.4

#: Largest standard deviation of the logarithm of the power from a filter's law.
#: Unit: 1. Origin: chosen.
LAW_HOLDS = 0.5

#: Ratio of the last frequency above the floor to the lowest one fitted, below which the
#: body may bend.
#: Unit: 1. Origin: chosen.
SLOWER = 5

#: Least exponent of the frequency in the power of the unfiltered noise.
#: Unit: 1. Origin: chosen.
LEAST_SLOPE = -2.5

#: Largest exponent of the frequency in the power of the unfiltered noise.
#: Unit: 1. Origin: chosen.
LARGEST_SLOPE = 0.5

# Poles of the Butterworth filters that are tried, which run forwards and backwards.
POLES = (2, 4)

#: What a power is never below, so that neither a quotient nor a logarithm fails.
#: Unit: 1. Origin: rounding: far above that of sums of squares near 1.
TINY = 1e-12


def treated(body: FloatArray, rate_hz: float, *, scale: float = 1.0) -> list[Message]:
    """Report processing of markers (N, m, 3), m, of a rigid part after recording."""
    body = middle(body)
    period = frames_of_pattern(body)
    if period:
        values = {"period": period, "rate_hz": float(rate_hz)}
        return [Message("recordings.resampled", values)]
    noise_m = _usual_noise(body)
    if len(body) < 2 * SEGMENT or not noise_m < NO_CAMERA_M * scale:
        return []
    values = {"noise_um": 1e6 * noise_m}
    found = low_pass_of(body)
    if found is None:
        return [Message("recordings.smoothed", values)]
    cut_off_hz = found.cut_off * rate_hz
    return [Message("recordings.low_pass", {**values, "cut_off_hz": cut_off_hz})]


@dataclass(frozen=True)
class LowPass:
    """A Butterworth filter that ran forwards and backwards.

    Parameters
    ----------
    cut_off : float
        Its cut-off, 3 dB in each direction, relative to the frame rate.
    poles : int
        Its poles in each direction.
    known_to : float
        Frequency up to which its output stands above the rounding floor, relative to
        the frame rate.
    """

    cut_off: float
    poles: int
    known_to: float

    def gain(self, frequency: FloatArray) -> FloatArray:
        """Return what is left of an amplitude at frequencies relative to the rate."""
        ratio = np.tan(np.pi * frequency) / np.tan(np.pi * self.cut_off)
        return np.asarray(1.0 / (1.0 + ratio ** (2 * self.poles)))


def low_pass(body: FloatArray, *, scale: float = 1.0) -> float:
    """Return the `cut_off` of filtered markers (N, m, 3), m; 0 if unfiltered."""
    body = middle(body)
    if _usual_noise(body) < NO_CAMERA_M * scale:
        return cut_off(body)
    return 0.0


def _usual_noise(body: FloatArray) -> float:
    """Return the median frame-to-frame noise of markers (N, m, 3)."""
    return float(quantiles(frame_noise(body)[:, None], [0.5])[0, 0])


def middle(body: FloatArray) -> FloatArray:
    """Return the middle frames, from which the processing of all frames is inferred."""
    first = max(0, (len(body) - SPECTRUM_FRAMES) // 2)
    return body[first : first + SPECTRUM_FRAMES]


def recorded_frames(body: FloatArray) -> slice:
    """Select the recorded frames of (N, m, 3): all, or those between made-up frames.

    Every second frame may be made up. Recorded frames have more noise and are not
    copies. In other patterns too few frames coincide with recorded ones.
    """
    n_even = len(body) // 2 * 2
    body = middle(body[:n_even])
    if round(frames_of_pattern(body), 2) != 2:
        return slice(None)
    has_moved = np.diff(body, axis=0, prepend=body[1:2]) != 0
    noise = []
    for first in (0, 1):
        share_moved = has_moved[first::2].mean()
        noise.append(share_moved * np.nanmedian(frame_noise(body[first::2])))
    return slice(int(np.argmax(noise)), None, 2)


def frames_of_pattern(body: FloatArray) -> float:
    """Return the period, frames, of a pattern in the noise of (N, m, 3); 0 if none.

    Frames between the recorded ones have less noise, or are copies.
    """
    if len(body) < SEGMENT or not body.size:
        return 0.0
    rough = _roughness(body.reshape(len(body), -1))
    rough -= rough.mean()
    power = np.abs(np.fft.rfft(rough)) ** 2
    frequency = np.fft.rfftfreq(len(rough))
    at = int(np.argmax(np.where(frequency < QUICKEST, 0.0, power)))
    usual = np.median(power[max(0, at - SEGMENT // 2) : at + SEGMENT // 2])
    share = 2 * power[at] / max(len(rough) * float(rough @ rough), TINY)
    if share > PATTERN_SHARE and power[at] > PATTERN_PEAK * usual:
        return 1 / frequency[at]
    return 0.0


def _roughness(tracks: FloatArray) -> FloatArray:
    """Return how rough coordinates (N, K) are in each frame but the last four."""
    rough = np.abs(np.diff(tracks, 4, axis=0))
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.minimum(rough / quantiles(rough, [0.5]), ROUGHEST)
    of_noise = np.nan_to_num(relative, nan=1.0).mean(axis=1)
    copied = (np.diff(tracks, axis=0)[:-3] == 0).mean(axis=1)
    return np.asarray(of_noise + COPY * copied)


def cut_off(body: FloatArray) -> float:
    """Return the cut-off of a filter applied to markers of a rigid part; 0 if none.

    Relative to the frame rate; see `low_pass_of`.
    """
    found = low_pass_of(body)
    return 0.0 if found is None else found.cut_off


def low_pass_of(body: FloatArray) -> LowPass | None:
    """Return the filter that was applied to markers of a rigid part; None if none was.

    It is fitted to the spectra of the distances, assuming that the unfiltered noise is
    a power of the frequency.

    Parameters
    ----------
    body : (N, m, 3) array
        Positions in any unit.
    """
    from scipy.signal import welch

    i, j = np.triu_indices(body.shape[1], 1)
    apart = np.linalg.norm(body[:, i] - body[:, j], axis=2)
    apart = apart[np.isfinite(apart).all(axis=1)]
    if len(apart) < 2 * SEGMENT or not apart.size:
        return None
    frequency, of_pairs = welch(apart, 1.0, nperseg=SEGMENT, axis=0, detrend="linear")
    frequency = frequency[2:-1]
    power = np.median(of_pairs[2:-1], axis=1)
    floor = np.median(power[frequency > FLOOR_FROM])
    above = np.flatnonzero(power > ABOVE_FLOOR * floor)
    last = int(above.max(initial=0))
    if not last:
        return None
    fitted = slice(last // SLOWER, last + 1)
    found = _fitted_filter(frequency[fitted, None], power[fitted, None])
    if found is None:
        return None
    return LowPass(*found, known_to=float(frequency[last]))


def _fitted_filter(
    frequency: FloatArray, power: FloatArray
) -> tuple[float, int] | None:
    """Return cut-off and poles of the filter that explains a spectrum (K, 1)."""
    grid = np.meshgrid(np.geomspace(0.01, 0.4, 100), POLES)
    cuts, poles = (axis.ravel() for axis in grid)
    # The logarithm of what a filter takes away is added again; noise is left.
    ratio = np.tan(np.pi * frequency) / np.tan(np.pi * cuts)
    loss = 2 * np.log1p(ratio ** (2 * poles))
    unfiltered = np.log(power + TINY**3) + loss
    law = np.log(frequency) ** [0, 1]
    coefficients = np.linalg.lstsq(law, unfiltered)[0]
    misfit = np.std(unfiltered - law @ coefficients, axis=0)
    slope = coefficients[1]
    misfit[(slope < LEAST_SLOPE) | (slope > LARGEST_SLOPE)] = np.inf
    best = int(misfit.argmin())
    if misfit[best] < LAW_HOLDS:
        return float(cuts[best]), int(poles[best])
    return None
