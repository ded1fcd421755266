"""Maximum-likelihood contact instants: a flight curve that ends in a kink on the floor.

With s = t - tau, the height of foot i about its contact at tau is modelled as

    z = c + b s + a s^2 / 2 + sum_j [a_j d_j2(t) + s_j d_j3(t)]     before,
    z = c + k b T (1 - exp(-s / T)) + r s                           after,

with d_jk(t) = ((t - tau_j)_+^k - (tau - tau_j)^k) / k! - s (tau - tau_j)^(k-1) / (k -
1)! for the feet j that touched earlier. Their springy legs push the body, so the
acceleration of a foot still in flight changes by a_j and its jerk by s_j, while its
velocity is continuous. If j is a marker of the same rigid foot, the foot then turns
about it and its velocity changes: s_j d_j1 replaces s_j d_j3. T is the compliance of
the contact, the same in all landings (0: the foot stops at once), k the share of the
velocity that is not lost at once, and r is the creep of a standing foot.

Missing frames are left out of the likelihood. The coefficients are integrated out: if
the likelihood were only maximised over them, a late instant could win because pushes
then mimic the contact. Normal priors range from flat (free curvature) to sharp (known
gravity); `kink_law` learns them from the recording.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray

BLOCK = 10_000  # fits whose frames are cut out together, to bound memory

#: Step of the search for the instant, in frames.
#: Unit: frames. Origin: chosen.
GRID_FRAMES = 0.5

#: Smallest step of the search for the instant.
#: Unit: s. Origin: chosen.
GRID_S = 2e-3

#: Frames that show the foot, before and after the contact, that a window holds at
#: least: the five coefficients of a kink and some to spare. With half as many more (7
#: and 5) a rolling foot is fitted where its law no longer holds.
#: Unit: frames. Origin: chosen.
WINDOW_FRAMES = (5, 3)

#: Where frames are hidden, a window reaches further until it holds `WINDOW_FRAMES`, but
#: at most to this multiple of its own length: the animal may have done something else
#: meanwhile.
#: Unit: 1. Origin: chosen.
WIDEST = 2.0

#: The search begins no later than at this share of its reach after the rough instant,
#: however late the earliest instant is.
#: Unit: 1. Origin: chosen.
LATEST_BOUND = 0.9

# Columns that the kernel gives before the coefficients: see `kink_kernel.fit_all`.
SUMMARY_COLUMNS = 7

# Coefficients of one foot among n. The first two, floor and velocity, have no prior.
# Those with a prior are 2n: its own acceleration, then a pair for each other foot (the
# changes of acceleration and jerk when that foot touches), then the creep. The pairs
# stand in the order of the feet in `FlightPriors` and `KinkFits`, but in order of time
# in the kernel.
N_WITHOUT_PRIOR = 2
ACCELERATION_CHANGES = slice(1, -1, 2)
JERK_CHANGES = slice(2, -1, 2)


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

    @cached_property
    def hinged(self) -> BoolArray:
        """Mark which of the others, in order, are markers of one foot, (n, n - 1)."""
        feet = np.arange(len(self.mean))
        if self.foot_of:
            feet = np.array(self.foot_of)
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


def kink_fits(  # noqa: PLR0913 (the data, and what is asked of each fit)
    time: FloatArray,
    heights: FloatArray,
    near: FloatArray,
    *,
    priors: FlightPriors,
    noise_m: float,
    windows_s: tuple[float, float],
    search_s: float,
    earliest: FloatArray | None = None,
    all_contacts: FloatArray | None = None,
    compliance_s: float = 0.0,
    kept: float = 1.0,
    creeps: bool = False,
    leaves_m: float = np.inf,
    frame_s: float | None = None,
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
    all_contacts : (L, n) array, optional
        Contact instants of all feet, s. Those before a foot's own change its
        acceleration. If not given, no foot acts on another.
    compliance_s : float
        Time constant with which a contact takes up the foot's velocity, s.
    kept : float
        Share of the velocity that is taken up so; the rest is lost at once.
    creeps : bool
        Whether a standing foot may creep.
    leaves_m : float
        Rise at which a standing foot has left the floor again, m. Frames from the one
        before that rise on are not used.
    frame_s : float, optional
        Usual time between two frames, s; by default their median.

    Returns
    -------
    KinkFits
    """
    # Compiled: Numba is slow to import.
    from hopdata.landings.contacts.kink_kernel import fit_all

    n = near.shape[1]
    wanted = np.flatnonzero(~np.isnan(near.ravel()))
    foot = wanted % n
    centre = near.ravel()[wanted]
    before_s = windows_s[0]  # the kernel's unit of time
    reach = search_s / before_s
    if frame_s is None:
        frame_s = float(np.median(np.diff(time)))
    step_s = max(GRID_FRAMES * frame_s, GRID_S)
    steps = max(int(np.ceil(2 * search_s / step_s)), 2)
    bounds = np.full(len(wanted), -np.inf)
    if earliest is not None:
        earliest_allowed = (earliest.ravel()[wanted] - centre) / before_s
        bounds = np.minimum(earliest_allowed, LATEST_BOUND * reach)

    others_s, order = _other_contacts(all_contacts, wanted, n)
    others = (others_s - centre[:, None]) / before_s
    n_others = (others < reach).sum(axis=1)
    is_hinged = np.take_along_axis(priors.hinged[foot], order, axis=1)

    units = _units(priors.hinged, before_s)
    units_with_prior = units[:, N_WITHOUT_PRIOR:]
    columns = _columns_by_time(order)
    rows_of_fit = np.arange(len(wanted))[:, None]
    means = (priors.mean / units_with_prior)[foot][rows_of_fit, columns]
    unit_precision = (noise_m / priors.sd * units_with_prior) ** 2
    weights = unit_precision[foot][rows_of_fit, columns]
    rows = np.full((len(wanted), SUMMARY_COLUMNS + 2 * units.shape[1]), np.nan)
    for first in range(0, len(wanted), BLOCK):
        part = slice(first, first + BLOCK)
        times, z, used = _windows(
            time, heights, foot[part], centre[part], windows_s, frame_s
        )
        since = times - centre[part, None]
        has_left = _has_left(since, z, leaves_m)
        fit_all(
            since / before_s,
            np.where(used & ~has_left, z, np.nan),
            bounds[part],
            reach,
            steps,
            n_others[part],
            np.stack([others[part], is_hinged[part]], axis=2),
            compliance_s / before_s,
            kept,
            creeps,
            means[part],
            weights[part],
            noise_m**2,
            rows[part],
        )
    per_second = units[0, 1]  # the kernel's unit of time is 1 / per_second
    rows[:, 0] = centre + rows[:, 0] / per_second
    return _unpack(rows, wanted, near.shape, columns, units)


def _units(hinged: BoolArray, before_s: float) -> FloatArray:
    """Return the factors (n, 2n + 2) that convert the kernel's coefficients to SI.

    The kernel's unit of time is `before_s`, so each coefficient has a power of it:
    floor 0, velocity and creep 1, accelerations 2, jerks 3, or 1 if the other is a
    marker of the same foot (`hinged`), which changes the velocity instead.
    """
    n = len(hinged)
    seconds = np.tile([0, 1, 2, *[2, 3] * (n - 1), 1], (n, 1))
    seconds[:, N_WITHOUT_PRIOR:][:, JERK_CHANGES] -= 2 * hinged
    return before_s ** -seconds.astype(float)


def _windows(
    time: FloatArray,
    heights: FloatArray,
    foot: IntArray,
    centre: FloatArray,
    windows_s: tuple[float, float],
    frame_s: float,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Cut out times and heights about each of P instants, and mark those to use.

    All three are (P, W). Used are the frames in the windows before and after the
    instant. If a window holds fewer than `WINDOW_FRAMES` that show the foot, the next
    ones that do are used as well, as far as `WIDEST` allows. Two more frames are cut
    out, but not used: they tell whether the foot rises after the last one.
    """
    before_s, after_s = windows_s
    reach = 1.0
    if np.isnan(heights).any():
        reach = WIDEST
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
    # How many frames show the foot from each frame to the instant.
    n_to_instant = np.cumsum(before[:, ::-1], axis=1)[:, ::-1]
    n_from_instant = np.cumsum(after, axis=1)
    nearest_before = before & (n_to_instant <= WINDOW_FRAMES[0])
    nearest_after = after & (n_from_instant <= WINDOW_FRAMES[1])
    nearest = nearest_before | nearest_after
    return times, z, in_windows | nearest


def _has_left(since: FloatArray, z: FloatArray, rise_m: float) -> BoolArray:
    """Mark the frames (P, W) from the one before the foot has left the floor again.

    `since` (P, W) is the time of each frame from the approximate contact, s.
    """
    is_seen = z < np.inf  # false for NaN
    down = np.where((since > 0) & is_seen, z, np.inf)
    lowest_so_far = np.minimum.accumulate(down, axis=1)
    risen = np.cumsum(z > lowest_so_far + rise_m, axis=1) > 0
    risen[:, :-1] |= risen[:, 1:]  # and the frame before
    return np.asarray(risen)


def _other_contacts(
    all_contacts: FloatArray | None, wanted: IntArray, n: int
) -> tuple[FloatArray, IntArray]:
    """Return when the other feet touched, and which they are.

    Parameters
    ----------
    all_contacts : (L, n) array or None
        Contact instants of all feet, s.
    wanted : (P,) int array
        Flat indices of the contacts that are fitted.
    n : int
        Number of feet.

    Returns
    -------
    contact : (P, n - 1) array
        Contacts of the other feet in order of time, s; inf where there is none.
    order : (P, n - 1) int array
        Which of the other feet each is: 0 for the first of them, and so on.
    """
    foot = wanted % n
    others_of = [[j for j in range(n) if j != i] for i in range(n)]
    others = np.array(others_of, dtype=np.int64)[foot]
    contact = np.full(others.shape, np.inf)
    if all_contacts is not None:
        known = all_contacts[(wanted // n)[:, None], others]
        contact = np.nan_to_num(known, nan=np.inf, posinf=np.inf)
    order = np.argsort(contact, axis=1, kind="stable")
    return np.take_along_axis(contact, order, axis=1), order


def _columns_by_time(order: IntArray) -> IntArray:
    """Return the columns of `FlightPriors`, (P, 2n), as the kernel has them.

    `order` (P, n - 1) says which of the other feet touches first, second and so on.
    """
    n = 1 + order.shape[1]
    columns = np.zeros((len(order), 2 * n), dtype=np.int64)
    columns[:, ACCELERATION_CHANGES] = 1 + 2 * order
    columns[:, JERK_CHANGES] = 2 + 2 * order
    columns[:, -1] = 2 * n - 1
    return columns


def _unpack(
    rows: FloatArray,
    wanted: IntArray,
    shape: tuple[int, int],
    columns: IntArray,
    units: FloatArray,
) -> KinkFits:
    """Name the kernel's columns, in the order of the feet and in SI.

    `columns` are those of `_columns_by_time`, `units` those of `_units`.
    """
    n_coefficients = units.shape[1]
    without_prior = np.tile(np.arange(N_WITHOUT_PRIOR), (len(wanted), 1))
    place = np.concatenate([without_prior, N_WITHOUT_PRIOR + columns], axis=1)
    estimates = slice(SUMMARY_COLUMNS, SUMMARY_COLUMNS + n_coefficients)
    variances = slice(SUMMARY_COLUMNS + n_coefficients, None)
    for part in (estimates, variances):
        by_time = rows[:, part].copy()
        np.put_along_axis(rows[:, part], place, by_time, axis=1)
    flat = np.full((shape[0] * shape[1], rows.shape[1]), np.nan)
    flat[wanted] = rows
    out = flat.reshape(*shape, rows.shape[1])
    summary = np.moveaxis(out[..., :SUMMARY_COLUMNS].copy(), 2, 0)
    instant, variance, misfit, dof, before, after, evidence = summary
    value = out[:, :, estimates] * units
    se = np.sqrt(np.maximum(out[:, :, variances], 0.0)) * units
    per_second = units[0, 1]  # the kernel's unit of time is 1 / per_second
    return KinkFits(
        instant=instant,
        unit_se=np.sqrt(variance) / per_second,
        floor=value[:, :, 0],
        velocity=value[:, :, 1],
        flight=value[:, :, N_WITHOUT_PRIOR:],
        unit_flight_se=se[:, :, N_WITHOUT_PRIOR:],
        misfit=misfit,
        evidence=evidence,
        dof=dof,
        n_before=np.nan_to_num(before).astype(np.int64),
        n_after=np.nan_to_num(after).astype(np.int64),
    )
