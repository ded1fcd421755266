"""The kink fit against its statistical limit."""

from dataclasses import replace

import numpy as np
import pytest

from hopdata.landings.contacts.kink import FlightPriors, kink_fits
from hopdata.landings.contacts.learning import learn, pooled_noise
from hopdata.landings.contacts.noise import LEAST_NOISE_M

RATE, SPEED, GRAVITY, NOISE = 100.0, 1.0, 9.81, 6e-4
WINDOWS = (0.08, 0.05)


def prior(n, own_mean=0.0, own_sd=1e4, change=(0.0, 30.0), jerk=(0.0, 500.0)):
    mean = np.tile([own_mean] + [change[0], jerk[0]] * (n - 1) + [0.0], (n, 1))
    sd = np.tile([own_sd] + [change[1], jerk[1]] * (n - 1) + [0.1], (n, 1))
    return FlightPriors(mean, sd)


def single_kinks(landings, seed=0, noise=NOISE):
    """Return feet that fall at 1 m/s onto a hard floor and stay, one every half second."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(landings * 0.5 * RATE)) / RATE
    contact = 0.25 + 0.5 * np.arange(landings) + rng.uniform(0, 1 / RATE, landings)
    s = time - np.repeat(contact, int(0.5 * RATE))
    height = np.where(s < 0, -SPEED * s - 0.5 * GRAVITY * s**2, 0.0)
    return time, (height + rng.normal(0, noise, len(time)))[:, None], contact[:, None]


def fit(time, height, near, **options):
    options = {
        "priors": prior(near.shape[1]),
        "noise_m": NOISE,
        "search_s": 0.02,
    } | options
    return kink_fits(time, height, near, **({"windows_s": WINDOWS} | options))


def bound(parameters):
    """Return the Cramer-Rao bound of the instant, averaged over the phase of the frames."""
    variances = []
    for phase in np.linspace(0, 1 / RATE, 21)[:-1]:
        s = np.arange(-8, 5) / RATE + phase
        before = s < 0
        columns = [np.ones_like(s), np.where(before, s, 0.0)]
        if parameters == "free":
            columns.append(np.where(before, s**2, 0.0))
        slope = np.where(before, SPEED + GRAVITY * s, 0.0)
        jacobian = np.column_stack([slope, *columns])
        variances.append(np.linalg.inv(jacobian.T @ jacobian)[0, 0])
    return NOISE * np.sqrt(np.mean(variances))


def test_noiseless_instants_are_exact():
    time, height, contact = single_kinks(30, noise=0.0)
    found = fit(time, height, contact + 0.004, noise_m=1e-7)
    np.testing.assert_allclose(found.instant, contact, atol=3e-5)
    np.testing.assert_allclose(found.velocity, -SPEED, atol=2e-3)
    np.testing.assert_allclose(found.flight[:, 0, 0], -GRAVITY, atol=0.2)
    np.testing.assert_allclose(found.floor, 0.0, atol=2e-6)


@pytest.mark.parametrize(
    ("gravity", "own"), [("free", (0.0, 1e4)), ("known", (-GRAVITY, 1e-3))]
)
def test_error_is_at_the_statistical_limit_and_calibrated(gravity, own):
    time, height, contact = single_kinks(3000)
    found = fit(time, height, contact + 0.003, priors=prior(1, *own))
    error = (found.instant - contact)[:, 0]
    assert error.std() < 1.12 * bound(gravity)
    assert abs(error.mean()) < 0.1 * error.std()
    assert 0.63 < np.mean(np.abs(error) < NOISE * found.unit_se[:, 0]) < 0.73
    assert pooled_noise(found) == pytest.approx(NOISE, rel=0.03)


def test_missing_frames_are_absent_from_the_likelihood():
    time, height, contact = single_kinks(1000)
    first = np.searchsorted(time, contact[:, 0]) - 1
    height[first[:, None] + np.arange(3)] = np.nan  # three frames about each contact
    found = fit(time, height, contact + 0.003, priors=prior(1, -GRAVITY, 1e-3))
    error = (found.instant - contact)[:, 0]
    assert error.std() < 0.00075
    assert 0.62 < np.mean(np.abs(error) < NOISE * found.unit_se[:, 0]) < 0.74
    assert (found.n_before + found.n_after <= 10).all()


def pushed_pairs(landings, push, jerk, seed=0):
    """Return two feet; the contact of the first changes the acceleration of the second."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(landings * 0.5 * RATE)) / RATE
    base = 0.25 + 0.5 * np.arange(landings) + rng.uniform(0, 1 / RATE, landings)
    later = rng.uniform(0.005, 0.04, landings)
    s = time - np.repeat(base, int(0.5 * RATE))
    first = np.where(s < 0, -2 * s - 0.5 * GRAVITY * s**2, 0.0)
    after = np.clip(s, 0, None)
    strength = np.repeat(push + rng.normal(0, 3, landings), int(0.5 * RATE))
    fall = -2 * s - 0.5 * GRAVITY * s**2 + strength * after**2 / 2 + jerk * after**3 / 6
    gap = np.repeat(later, int(0.5 * RATE))
    at_contact = (
        -2 * gap - 0.5 * GRAVITY * gap**2 + strength * gap**2 / 2 + jerk * gap**3 / 6
    )
    second = np.where(s < gap, fall - at_contact, 0.0)
    heights = np.column_stack([first, second]) + rng.normal(0, NOISE, (len(time), 2))
    return time, heights, np.column_stack([base, base + later])


def test_a_rigid_foot_turns_about_the_marker_that_touches_first():
    rng = np.random.default_rng(4)
    time, landings = np.arange(40 * 50) / RATE, 40
    toe = 0.25 + 0.5 * np.arange(landings) + rng.uniform(0, 1 / RATE, landings)
    heel = toe + rng.uniform(0.03, 0.06, landings)
    s, left = (time - np.repeat(at, 50) for at in (toe, heel))
    turns = np.where(s < 0, 1.5 * s, 0.0)  # the heel slows by 1.5 m/s as the toes touch
    heights = np.column_stack(
        [np.where(s < 0, -2.5 * s, 0.0), np.where(left < 0, -1.5 * left, 0)]
    )
    heights[:, 1] -= turns
    heights += rng.normal(0, NOISE, heights.shape)
    contact = np.column_stack([toe, heel])
    found = fit(
        time,
        heights,
        contact + 0.002,
        all_contacts=contact,
        priors=replace(prior(2), foot_of=(0, 0)),
    )
    error = (found.instant - contact) / (NOISE * found.unit_se)
    np.testing.assert_allclose(np.sqrt(np.mean(error**2, axis=0)), 1.0, atol=0.25)
    assert np.median(found.flight[:, 1, 2]) == pytest.approx(1.5, abs=0.1)
    assert np.median(found.velocity[:, 1]) == pytest.approx(-1.5, abs=0.1)


def learn_alone(found, prior):
    """Learn from one recording."""
    (learned,) = learn(
        found,
        noise_m=np.array([NOISE]),
        priors=[prior],
        of_landing=np.zeros(len(found.instant), dtype=np.int64),
    )
    return learned


def test_the_push_of_an_earlier_foot_is_learned_and_taken_into_account():
    time, heights, contact = pushed_pairs(600, -16.0, 300.0)
    alone = fit(time, heights, contact + 0.002, priors=prior(2, -GRAVITY, 1e-3))
    learned, found = prior(2), alone
    for _ in range(6):
        found = fit(
            time, heights, found.instant, priors=learned, all_contacts=found.instant
        )
        learned = learn_alone(found, learned)
    assert learned.mean[1, 1] == pytest.approx(-16.0, abs=2.0)
    assert 3.0 < learned.sd[1, 1] < 9.0
    assert learned.mean[0, 0] == pytest.approx(-GRAVITY, abs=0.2)
    assert learned.mean[0, 1] == learned.mean[1, 1]  # foot 1 never waited: pooled
    error, ignored = (found.instant - contact)[:, 1], (alone.instant - contact)[:, 1]
    assert error.std() < 0.00035
    assert abs(error.mean()) < 0.0001
    assert (
        np.hypot(ignored.std(), ignored.mean()) > 3 * error.std()
    )  # control: no pushes
    assert 0.63 < np.mean(np.abs(error) < NOISE * found.unit_se[:, 1]) < 0.8


def test_nothing_to_learn_leaves_the_prior():
    time, heights, contact = pushed_pairs(5, -16.0, 0.0)
    start = prior(2)
    found = fit(time, heights, contact, priors=start, all_contacts=contact)
    learned = learn_alone(found, start)
    np.testing.assert_array_equal(learned.mean[:, 1:], start.mean[:, 1:])
    np.testing.assert_array_equal(learned.sd, start.sd)


def test_no_frames_no_fit():
    time, height, contact = single_kinks(3)
    height[: int(0.5 * RATE)] = np.nan
    near = contact.copy()
    near[1] = np.nan
    found = fit(time, height, near)
    assert np.isnan(found.instant[:, 0]).tolist() == [True, True, False]
    assert found.n_before[:2].tolist() == [[0], [0]]


def test_a_gap_that_leaves_two_frames_of_flight_fixes_no_instant():
    time, height, contact = single_kinks(200, seed=8)
    for row, at in enumerate(
        contact[:, 0]
    ):  # frames of every pattern just before the contact
        last = int(np.floor(at * RATE))
        height[last - 18 : last - row % 4, 0] = (
            np.nan
        )  # farther back than any window reaches
        height[last - row % 3, 0] = np.nan
    found = fit(time, height, contact + 0.003)
    assert not np.isnan(found.instant).all()
    few = found.n_before < 2
    assert few.any()
    assert not (found.unit_se[few] < 0.5).any()


def test_pooled_noise_is_never_below_what_cameras_do():
    time, height, contact = single_kinks(30, noise=0.0)
    assert pooled_noise(fit(time, height, contact)) == LEAST_NOISE_M


@pytest.mark.parametrize(
    ("hidden", "n_after"), [(0, 3), (2, 3), (3, 3), (4, 2), (6, 0)]
)
def test_a_window_counts_the_frames_that_show_the_foot_up_to_twice_its_length(
    hidden, n_after
):
    time, height, contact = single_kinks(40, seed=8)
    for at in contact[:, 0]:
        first = int(np.ceil(at * RATE))
        height[first : first + hidden, 0] = np.nan
    windows_s = (0.08, 3 / RATE)
    found = fit(time, height, contact, windows_s=windows_s)
    known = found.n_after[np.isfinite(found.instant)]
    assert (np.abs(known - n_after) <= 1).all()
    assert np.median(known) == n_after


def test_frames_hidden_elsewhere_move_no_contact():
    time, height, contact = single_kinks(40, seed=8)
    found = fit(time, height, contact)
    height[:20] = np.nan
    again = fit(time, height, contact)
    np.testing.assert_array_equal(again.instant[2:], found.instant[2:])
