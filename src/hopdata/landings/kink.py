"""Contact instants of largest likelihood: a flight curve that ends in a kink on the floor.

The height of foot i is modelled as

    z(t) = c                                                            after its contact at tau,
    z(t) = c + b (t - tau) + a (t - tau)^2 / 2 + sum_j [a_j d_j2(t) + s_j d_j3(t)]  before,

with d_jk(t) = ((t - tau_j)_+^k - (tau - tau_j)^k) / k! for the feet j that touched earlier: their
springy legs push the body, so the acceleration of a foot still in flight changes by a_j and its
jerk by s_j while its velocity is continuous. Frames that are missing are absent from the
likelihood, and the coefficients are integrated out: at its largest over them alone, a late contact
could hide behind the pushes. Normal priors reach from flat (free curvature) to sharp (known
gravity); `learn` takes them from the recording itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.landings.approach import LEAST_NOISE_M

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

TELLING = 0.9  # posterior over prior variance below which the data have said something
FEW = 8  # landings below which an entry is not learned on its own
OUTLYING = 4.0  # standard deviations at which an outlier is drawn in


@dataclass(frozen=True)
class FlightPriors:
    """Independent normal priors of the flight law of each of n feet.

    Parameters
    ----------
    mean, sd : (n, 2n - 1) array
        Row i holds foot i's own acceleration, m/s^2, and then for each other foot, in order, by how
        much the acceleration, m/s^2, and the jerk, m/s^3, of foot i change when that foot touches.
    """

    mean: FloatArray
    sd: FloatArray


@dataclass(frozen=True)
class KinkFits:
    """Kink fits of L landings and n feet; NaN where no fit was possible.

    Parameters
    ----------
    instant, unit_se : (L, n) array
        Contact instant, s, and its standard error per metre of position noise, s/m.
    floor, velocity : (L, n) array
        Height after the contact, m, and velocity just before it, m/s.
    flight, unit_flight_se : (L, n, 2n - 1) array
        The flight law, ordered as in `FlightPriors`, and its standard errors per metre of noise.
    misfit : (L, n) array
        Sum of squared residuals, m^2.
    dof : (L, n) array
        Frames less the effective number of parameters.
    n_before, n_after : (L, n) array
        Number of frames used on either side of the contact (0 where no fit was possible).
    """

    instant: FloatArray
    unit_se: FloatArray
    floor: FloatArray
    velocity: FloatArray
    flight: FloatArray
    unit_flight_se: FloatArray
    misfit: FloatArray
    dof: FloatArray
    n_before: IntArray
    n_after: IntArray


def kink_fits(
    time: FloatArray,
    heights: FloatArray,
    near: FloatArray,
    *,
    priors: FlightPriors,
    noise_m: float,
    windows_s: tuple[float, float],
    search_s: float,
    earlier: FloatArray | None = None,
) -> KinkFits:
    """Fit a kink to every foot of every landing.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    heights : (N, n) array
        Heights of the feet, m; NaN where unseen.
    near : (L, n) array
        Instants about which to search, s; NaN for none.
    priors : FlightPriors
        Priors of the flight laws.
    noise_m : float
        Standard deviation of a height, m; it weighs the data against the priors.
    windows_s : tuple of float
        Frames used, from `near` minus the one to `near` plus the other, s.
    search_s : float
        Half width of the search about `near`, s.
    earlier : (L, n) array, optional
        Contact instants of all feet, s. Those before a foot's own contact change its acceleration.
        Without it no foot acts on another.

    Returns
    -------
    KinkFits
    """
    from hopdata.landings.kink_kernel import fit_all  # compiled: Numba is slow to import

    landings, n = near.shape
    wanted = np.flatnonzero(~np.isnan(near.ravel()))
    centre = near.ravel()[wanted]
    before_s, after_s = windows_s
    times, z = _windows(time, heights, wanted % n, centre, before_s, after_s)
    contact, columns = _other_contacts(earlier, wanted, n)
    contact = (contact - centre[:, None]) / before_s
    reach = search_s / before_s
    frame_s = float(np.median(np.diff(time)))
    units = _column_units(n, before_s)
    foot = np.arange(len(wanted))[:, None], columns
    rows = np.full((len(wanted), 6 + 2 * len(units)), np.nan)
    fit_all(
        (times - centre[:, None]) / before_s,
        z,
        np.full(len(wanted), -reach),
        np.full(len(wanted), reach),
        int(np.ceil(2 * search_s / max(frame_s / 4, 1e-3))),
        (contact < reach).sum(axis=1),
        contact,
        (priors.mean / units[2:])[wanted % n][foot],
        ((noise_m / priors.sd * units[2:]) ** 2)[wanted % n][foot],
        noise_m**2,
        rows,
    )
    return _unpack(rows, wanted, (landings, n), columns, units, centre)


def _windows(
    time: FloatArray,
    heights: FloatArray,
    foot: IntArray,
    centre: FloatArray,
    before_s: float,
    after_s: float,
) -> tuple[FloatArray, FloatArray]:
    """Cut out times and heights about each of P instants, (P, W), NaN where there is no frame."""
    start = np.searchsorted(time, centre - before_s)
    stop = np.searchsorted(time, centre + after_s)
    frames = start[:, None] + np.arange(int(np.max(stop - start, initial=1)))
    inside = frames < stop[:, None]
    frames = np.minimum(frames, len(time) - 1)
    return time[frames], np.where(inside, heights[frames, foot[:, None]], np.nan)


def _other_contacts(
    earlier: FloatArray | None, wanted: IntArray, n: int
) -> tuple[FloatArray, IntArray]:
    """Contacts of the other feet in order of time, (P, n - 1), inf where there is none.

    Also the columns of `FlightPriors` in which they come, (P, 2n - 1).
    """
    foot = wanted % n
    others = np.array([[j for j in range(n) if j != i] for i in range(n)], dtype=np.int64)[foot]
    if earlier is None:
        contact = np.full(others.shape, np.inf)
    else:
        contact = earlier[(wanted // n)[:, None], others]
        contact = np.where(np.isnan(contact), np.inf, contact)
    order = np.argsort(contact, axis=1, kind="stable")
    columns = np.zeros((len(wanted), 2 * n - 1), dtype=np.int64)
    columns[:, 1::2], columns[:, 2::2] = 1 + 2 * order, 2 + 2 * order
    return np.take_along_axis(contact, order, axis=1), columns


def _column_units(n: int, scale: float) -> FloatArray:
    """Factors from the kernel's coefficients (heights, time in `scale`) to SI units, (2n + 1,)."""
    return np.array([1.0, 1 / scale] + [1 / scale**2] + [1 / scale**2, 1 / scale**3] * (n - 1))


def _unpack(
    rows: FloatArray,
    wanted: IntArray,
    shape: tuple[int, int],
    columns: IntArray,
    units: FloatArray,
    centre: FloatArray,
) -> KinkFits:
    """Name the kernel's columns, put them in the order of the feet and bring them to SI units."""
    size = len(units)
    own = np.concatenate([np.tile([0, 1], (len(wanted), 1)), 2 + columns], axis=1)
    sorted_rows = rows.copy()
    np.put_along_axis(sorted_rows[:, 6 : 6 + size], own, rows[:, 6 : 6 + size], axis=1)
    np.put_along_axis(sorted_rows[:, 6 + size :], own, rows[:, 6 + size :], axis=1)
    sorted_rows[:, 0] = centre + rows[:, 0] / units[1]
    flat = np.full((shape[0] * shape[1], rows.shape[1]), np.nan)
    flat[wanted] = sorted_rows
    out = flat.reshape(*shape, rows.shape[1])
    instant, variance, misfit, dof, before, after = np.moveaxis(out[:, :, :6], 2, 0)
    value = out[:, :, 6 : 6 + size] * units
    se = np.sqrt(np.maximum(out[:, :, 6 + size :], 0.0)) * units
    return KinkFits(
        instant,
        np.sqrt(variance) / units[1],
        value[:, :, 0],
        value[:, :, 1],
        value[:, :, 2:],
        se[:, :, 2:],
        misfit,
        dof,
        np.nan_to_num(before).astype(np.int64),
        np.nan_to_num(after).astype(np.int64),
    )


def pooled_noise(fits: KinkFits) -> float:
    """Estimate the standard deviation of a height about its fit, m, by the median of all fits.

    Never less than `LEAST_NOISE_M`.
    """
    use = fits.dof > 1
    if not use.any():
        return float("nan")
    dof = fits.dof[use]
    median = dof * (1 - 2 / (9 * dof)) ** 3  # Wilson and Hilferty's median of chi-squared
    return max(float(np.sqrt(np.median(fits.misfit[use] / median))), LEAST_NOISE_M)


def learn(fits: KinkFits, *, noise_m: float, prior: FlightPriors, own: bool = True) -> FlightPriors:
    """Take one step of expectation maximisation for the distributions behind the flight laws.

    The new mean and sd of an entry are those of the mixture of its posteriors over the landings in
    which the data say something about it. From wide priors the sd comes down towards the true one
    and does not undercut it. A foot's own acceleration is learned from the landings in which it was
    the first to touch, as no leg has pushed there. Entries with few such landings take what all
    entries of their kind say together, or stay as they were.

    Parameters
    ----------
    fits : KinkFits
        Fits made under `prior`.
    noise_m : float
        Standard deviation of a foot's height, m.
    prior : FlightPriors
        The prior of those fits.
    own : bool
        Whether to learn the feet's own accelerations as well.

    Returns
    -------
    FlightPriors
    """
    value, variance = fits.flight, (fits.unit_flight_se * noise_m) ** 2
    telling = (variance < TELLING * prior.sd**2) & np.isfinite(value)
    first = np.where(np.isnan(fits.instant), np.inf, fits.instant).argmin(axis=1)
    telling[:, :, 0] &= own & (first[:, None] == np.arange(len(prior.mean)))
    mean, sd = prior.mean.copy(), prior.sd.copy()
    for kind in (slice(0, 1), slice(1, None, 2), slice(2, None, 2)):  # own, change, jerk
        use = telling[:, :, kind]
        pooled = _mixture(value[:, :, kind][use], variance[:, :, kind][use])
        for i, j in [(i, j) for i in range(len(mean)) for j in range(mean.shape[1])[kind]]:
            use = telling[:, i, j]
            found = _mixture(value[use, i, j], variance[use, i, j]) or pooled
            mean[i, j], sd[i, j] = found or (prior.mean[i, j], prior.sd[i, j])
    return FlightPriors(mean, sd)


def _mixture(value: FloatArray, variance: FloatArray) -> tuple[float, float] | None:
    """Mean and sd of a mixture of normals, outliers drawn in; None if there are few."""
    if len(value) < FEW:
        return None
    reach = OUTLYING * float(np.std(value))
    middle = float(np.median(value))
    clipped = np.clip(value, middle - reach, middle + reach)
    return float(np.mean(clipped)), float(np.sqrt(np.mean(variance) + np.var(clipped)))
