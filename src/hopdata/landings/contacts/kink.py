"""Maximum-likelihood contact instants: a flight curve that ends in a kink on the floor.

With s = t - tau, the height of foot i about its contact at tau is modelled as

    z = c + b s + a s^2 / 2 + sum_j [a_j d_j2(t) + s_j d_j3(t)]     before,
    z = c + b T (1 - exp(-s / T)) + r s                             after,

with d_jk(t) = ((t - tau_j)_+^k - (tau - tau_j)^k) / k! - s (tau - tau_j)^(k-1) / (k -
1)! for the feet j that touched earlier. Their springy legs push the body, so the
acceleration of a foot still in flight changes by a_j and its jerk by s_j, while its
velocity is continuous. If j is a marker of the same rigid foot, the foot then turns
about it and its velocity changes: s_j d_j1 replaces s_j d_j3. T is the compliance of
the contact, the same in all landings (0: the foot stops at once), and r is the creep of
a standing foot.

Missing frames are left out of the likelihood. The coefficients are integrated out: if
the likelihood were only maximised over them, a late instant could win because pushes
then mimic the contact. Normal priors range from flat (free curvature) to sharp (known
gravity); `kink_law` learns them from the recording.
"""

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray

BLOCK = 10_000  # fits whose frames are cut out together, to bound memory
GRID_FRAMES, GRID_S = 0.5, 2e-3  # step of the search, in frames, and its lower limit, s
# Frames that show the foot, before and after the contact, that a window holds at least:
# the five coefficients of a kink and some to spare. With half as many more (7 and 5) a
# rolling foot is fitted where its law no longer holds.
WINDOW_FRAMES = (5, 3)
# Where frames are hidden, a window reaches further until it holds that many, but at
# most to this multiple of its own length: the animal may have done something else
# meanwhile.
WIDEST = 2.0


@dataclass(frozen=True)
class FlightPriors:
    """Independent normal priors of the laws of flight and stance of n feet.

    Parameters
    ----------
    mean, sd : (n, 2n) array
        Row i holds foot i's own acceleration, m/s^2; then, for each other foot in
        order, the changes of foot i's acceleration, m/s^2, and jerk, m/s^3, when that
        foot touches (for markers of one foot, of its acceleration and velocity, m/s);
        and last the creep of foot i when it stands, m/s.
    foot_of : tuple of int
        Number of the rigid foot that each belongs to, where several are markers of one.
    """

    mean: FloatArray
    sd: FloatArray
    foot_of: tuple[int, ...] = ()

    @property
    def hinged(self) -> BoolArray:
        """Mark which of the others, in order, are markers of the same foot, (n, n - 1)."""
        feet = np.array(self.foot_of or range(len(self.mean)))
        return np.stack([np.delete(feet, i) == foot for i, foot in enumerate(feet)])


@dataclass(frozen=True)
class KinkFits:
    """Kink fits of L landings and n feet; NaN where no fit was possible.

    Parameters
    ----------
    instant, unit_se : (L, n) array
        Contact instant, s, and its standard error per metre of position noise, s/m.
    floor, velocity : (L, n) array
        Height at the contact, m, and velocity just before it, m/s.
    flight, unit_flight_se : (L, n, 2n) array
        The coefficients of the law, ordered as in `FlightPriors`, and their standard
        errors per metre of noise.
    misfit : (L, n) array
        Sum of squared residuals, m^2.
    evidence : (L, n) array
        -2 times the log marginal likelihood, in units of the noise variance, m^2.
    dof : (L, n) array
        Number of frames minus the effective number of parameters.
    n_before, n_after : (L, n) array
        Number of frames used on either side of the contact (0 where no fit was
        possible).
    """

    instant: FloatArray
    unit_se: FloatArray
    floor: FloatArray
    velocity: FloatArray
    flight: FloatArray
    unit_flight_se: FloatArray
    misfit: FloatArray
    evidence: FloatArray
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
    earliest: FloatArray | None = None,
    earlier: FloatArray | None = None,
    compliance_s: float = 0.0,
    creeps: bool = False,
    leaves_m: float = np.inf,
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
        Time before and after `near` whose frames are used, s. Where frames are hidden,
        the windows reach further until they hold `WINDOW_FRAMES` that show the foot, up
        to `WIDEST` times.
    search_s : float
        Half width of the search about `near`, s.
    earliest : (L, n) array, optional
        Instants before which no contact is sought, s.
    earlier : (L, n) array, optional
        Contact instants of all feet, s. Contacts before a foot's own change its
        acceleration. If not given, no foot acts on another.
    compliance_s : float
        Time constant with which a contact takes up the foot's velocity, s.
    creeps : bool
        Whether a standing foot may creep.
    leaves_m : float
        Rise at which a standing foot has left the floor again, m. Frames from the one
        before that rise on are not used.

    Returns
    -------
    KinkFits
    """
    from hopdata.landings.contacts.kink_kernel import (
        fit_all,
    )  # compiled: Numba is slow to import

    landings, n = near.shape
    wanted = np.flatnonzero(~np.isnan(near.ravel()))
    centre = near.ravel()[wanted]
    before_s = windows_s[0]
    contact, columns = _other_contacts(earlier, wanted, n)
    contact = (contact - centre[:, None]) / before_s
    hinged = np.take_along_axis(
        priors.hinged[wanted % n], columns[:, 1:-1:2] // 2, axis=1
    )
    others = np.stack([contact, hinged], axis=2)
    reach = search_s / before_s
    bounds = np.full(len(wanted), -np.inf)
    if earliest is not None:
        bounds = np.minimum((earliest.ravel()[wanted] - centre) / before_s, 0.9 * reach)
    seconds = np.tile([0, 1, 2, *[2, 3] * (n - 1), 1], (n, 1))
    seconds[:, 4:-1:2] -= 2 * priors.hinged
    units = before_s ** -seconds.astype(
        float
    )  # convert the kernel's coefficients to SI
    foot = np.arange(len(wanted))[:, None], columns
    rows = np.full((len(wanted), 7 + 2 * units.shape[1]), np.nan)
    frame_s = float(np.median(np.diff(time)))
    steps = max(int(np.ceil(2 * search_s / max(GRID_FRAMES * frame_s, GRID_S))), 2)
    means = (priors.mean / units[:, 2:])[wanted % n][foot]
    weights = ((noise_m / priors.sd * units[:, 2:]) ** 2)[wanted % n][foot]
    for first in range(0, len(wanted), BLOCK):
        part = slice(first, first + BLOCK)
        times, z, used = _windows(
            time, heights, wanted[part] % n, centre[part], windows_s
        )
        risen = _risen(times - centre[part, None], z, leaves_m)
        z = np.where(used & ~risen, z, np.nan)
        fit_all(
            (times - centre[part, None]) / before_s, z, bounds[part], reach, steps,
            (contact[part] < reach).sum(axis=1), others[part], compliance_s / before_s, creeps,
            means[part], weights[part], noise_m**2, rows[part],
        )  # fmt: skip
    rows[:, 0] = centre + rows[:, 0] / units[0, 1]
    return _unpack(rows, wanted, (landings, n), columns, units)


def _windows(
    time: FloatArray,
    heights: FloatArray,
    foot: IntArray,
    centre: FloatArray,
    windows_s: tuple[float, float],
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Cut out times and heights about each of P instants, and mark those to use, (P, W).

    Used are the frames in the windows before and after the instant. If a window holds
    fewer than `WINDOW_FRAMES` that show the foot, the next ones that do are used as
    well, as far as `WIDEST` allows. Two more frames tell whether the foot rises after
    the last one.
    """
    frame_s = float(np.median(np.diff(time)))
    before_s, after_s = windows_s
    reach = WIDEST if np.isnan(heights).any() else 1.0
    first = np.searchsorted(time, centre - reach * before_s)
    stop = np.searchsorted(time, centre + reach * after_s + 2 * frame_s)
    frames = first[:, None] + np.arange(int(np.max(stop - first, initial=1)))
    inside = frames < stop[:, None]
    begin = np.searchsorted(time, centre - before_s)
    in_windows = frames >= begin[:, None]
    frames = np.minimum(frames, len(time) - 1)
    times = time[frames]
    z = np.where(inside, heights[frames, foot[:, None]], np.nan)
    since = times - centre[:, None]
    in_windows &= since < after_s
    within_reach = inside & (since < reach * after_s)
    seen = within_reach & ~np.isnan(z)
    before = seen & (since < 0)
    after = seen & (since >= 0)
    nearest_before = np.cumsum(before[:, ::-1], axis=1)[:, ::-1] <= WINDOW_FRAMES[0]
    nearest_after = np.cumsum(after, axis=1) <= WINDOW_FRAMES[1]
    nearest = (before & nearest_before) | (after & nearest_after)
    return times, z, in_windows | nearest


def _risen(since: FloatArray, z: FloatArray, rise_m: float) -> BoolArray:
    """Mark the frames (P, W) from the one before the foot has left the floor again.

    `since` (P, W) is the time of each frame from the approximate contact, s.
    """
    lowest = np.minimum.accumulate(
        np.where((since > 0) & (z < np.inf), z, np.inf), axis=1
    )
    risen = np.cumsum(z > lowest + rise_m, axis=1) > 0
    risen[:, :-1] |= risen[:, 1:]
    return np.asarray(risen)


def _other_contacts(
    earlier: FloatArray | None, wanted: IntArray, n: int
) -> tuple[FloatArray, IntArray]:
    """Return the contacts of the other feet in order of time, (P, n - 1), inf where there is none.

    Also return the columns of `FlightPriors` in that order, (P, 2n).
    """
    foot = wanted % n
    others = np.array(
        [[j for j in range(n) if j != i] for i in range(n)], dtype=np.int64
    )[foot]
    contact = np.full(others.shape, np.inf)
    if earlier is not None:
        contact = np.nan_to_num(
            earlier[(wanted // n)[:, None], others], nan=np.inf, posinf=np.inf
        )
    order = np.argsort(contact, axis=1, kind="stable")
    columns = np.zeros((len(wanted), 2 * n), dtype=np.int64)
    columns[:, 1:-1:2], columns[:, 2:-1:2] = 1 + 2 * order, 2 + 2 * order
    columns[:, -1] = 2 * n - 1
    return np.take_along_axis(contact, order, axis=1), columns


def _unpack(
    rows: FloatArray,
    wanted: IntArray,
    shape: tuple[int, int],
    columns: IntArray,
    units: FloatArray,
) -> KinkFits:
    """Name the kernel's columns, put them in the order of the feet and convert them to SI."""
    size = units.shape[1]
    own = np.concatenate([np.tile([0, 1], (len(wanted), 1)), 2 + columns], axis=1)
    for part in (slice(7, 7 + size), slice(7 + size, None)):
        np.put_along_axis(rows[:, part], own, rows[:, part].copy(), axis=1)
    flat = np.full((shape[0] * shape[1], rows.shape[1]), np.nan)
    flat[wanted] = rows
    out = flat.reshape(*shape, rows.shape[1])
    instant, variance, misfit, dof, before, after, evidence = np.moveaxis(
        out[..., :7].copy(), 2, 0
    )
    value = out[:, :, 7 : 7 + size] * units
    se = np.sqrt(np.maximum(out[:, :, 7 + size :], 0.0)) * units
    floor, velocity, law = (
        value[:, :, 0],
        value[:, :, 1],
        (value[:, :, 2:], se[:, :, 2:]),
    )
    counts = (np.nan_to_num(frames).astype(np.int64) for frames in (before, after))
    unit_se = np.sqrt(variance) / units[0, 1]
    return KinkFits(
        instant, unit_se, floor, velocity, *law, misfit, evidence, dof, *counts
    )
