"""Feet at the pre section, on bodies whose legs scatter and swing in flight."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hopdata.landings.states.feet import feet_at_section
from hopdata.landings.states.fits import section_states
from hopdata.landings.states.home_frames import HomeFrames

GRAVITY, PERIOD_S, SECTION_M = 9.81, 0.7, 0.35
BODY = np.array([[0.13, 0.03, 0.0], [-0.06, 0.11, 0.01], [-0.07, -0.14, -0.01]])
FEET = np.array([[0.3, 0.0, -0.27], [-0.15, 0.26, -0.27], [-0.15, -0.26, -0.27]])
SWINGS_HZ = 3.0


@dataclass(frozen=True)
class Landings:
    """Landings of three feet, with the truth at the section in the home frame."""

    time: np.ndarray
    body: np.ndarray
    feet: np.ndarray
    contacts: np.ndarray
    crossing: np.ndarray
    home: HomeFrames
    true_feet: np.ndarray
    noise_m: float

    def found(self, parts=None, **options):
        """Return the feet and their standard errors."""
        first = self.contacts.min(axis=1)
        states = section_states(
            self.time,
            self.body,
            self.crossing,
            height_m=SECTION_M,
            side="before",
            contact=first,
        )
        if parts is None:
            parts = [self.feet[:, [foot]] for foot in range(3)]
        numbers = iter(range(sum(part.shape[1] for part in parts)))
        markers = [[next(numbers) for _ in range(part.shape[1])] for part in parts]
        return feet_at_section(
            self.time,
            np.concatenate(parts, axis=1),
            markers,
            states,
            self.home,
            contacts=self.contacts,
            contacts_se=np.full(self.contacts.shape, self.noise_m / 3.0),
            **options,
        )


def landings(n=150, *, rate_hz=100.0, noise_m=0.0006, swing_m=0.03, seed=1):
    """Fall n times on legs whose length scatters by 8 mm and that swing by `swing_m`."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(n * PERIOD_S * rate_hz)) / rate_hz
    hop = np.minimum((time / PERIOD_S).astype(int), n - 1)
    # The windows of the fits hold frames of the stance before the shortest flights.
    start = (np.arange(n) + 0.05) * PERIOD_S + rng.uniform(0, 0.01, n)
    speed = rng.normal([0.1, 0.0, 0.0], 0.1, (n, 3))
    tilt, spin = rng.normal(0, 0.05, (n, 3)), rng.normal(0, 0.3, (n, 3))
    heading = rng.uniform(0, 2 * np.pi, n)
    legs = 0.008 * rng.standard_normal((n, 3))
    phase = rng.normal(0.5, 0.3, (n, 3))
    width = swing_m * (1 + 0.2 * rng.standard_normal((n, 3)))

    def places(since, hop):
        fall = np.column_stack([0 * since, 0 * since, -0.5 * GRAVITY * since**2])
        centre = speed[hop] * since[:, None] + fall + [0.0, 0.0, 0.55]
        about = np.column_stack([0 * since, 0 * since, heading[hop]])
        turn = Rotation.from_rotvec(about) * Rotation.from_rotvec(
            tilt[hop] + spin[hop] * since[:, None]
        )
        body = [turn.apply(np.tile(point, (len(since), 1))) for point in BODY]
        feet = []
        for foot, rest in enumerate(FEET):
            angle = 2 * np.pi * SWINGS_HZ * since + phase[hop, foot]
            arm = np.tile(rest, (len(since), 1))
            arm[:, 0] += width[hop, foot] * np.sin(angle)
            arm[:, 2] += 0.5 * width[hop, foot] * np.cos(angle) - legs[hop, foot]
            feet.append(turn.apply(arm))
        return centre[:, None] + np.stack([*body, *feet], axis=1)

    fine = np.linspace(0.1, 0.33, 3000)
    contacts, crossing, true = np.empty((n, 3)), np.empty(n), np.empty((n, 3, 3))
    home = HomeFrames(
        np.zeros((n, 2)), np.column_stack([np.cos(heading), np.sin(heading)])
    )
    for k in range(n):
        every = places(fine, np.full(len(fine), k))
        for foot in range(3):
            contacts[k, foot] = np.interp(0, -every[:, 3 + foot, 2], fine)
        since = np.interp(-SECTION_M, -every[:, :3, 2].mean(axis=1), fine)
        true[k] = places(np.array([since]), np.array([k]))[0, 3:]
        crossing[k] = since
    contacts += start[:, None]
    crossing += start

    markers = places(time - start[hop], hop)
    is_down = time[:, None] > contacts[hop]
    markers[:, 3:, 2] = np.where(is_down, 0.0, markers[:, 3:, 2])
    late = np.maximum(time - contacts.min(axis=1)[hop], 0.0)
    markers[:, :3, 2] += 20 * late[:, None] ** 2
    markers += noise_m * rng.standard_normal(markers.shape)
    return Landings(
        time,
        markers[:, :3],
        markers[:, 3:],
        contacts,
        crossing,
        home,
        home.points(true),
        noise_m,
    )


@pytest.mark.parametrize(
    ("rate_hz", "noise_m", "swing_m"),
    [(100, 0.0006, 0.03), (100, 0.003, 0.0), (250, 0.0002, 0.03), (250, 0.003, 0.03)],
)
def test_errors_are_as_stated(rate_hz, noise_m, swing_m):
    made = landings(rate_hz=rate_hz, noise_m=noise_m, swing_m=swing_m)
    feet, feet_se = made.found()
    relative = (feet - made.true_feet) / feet_se
    of_axes = np.sqrt(np.mean(relative**2, axis=(0, 1)))
    assert ((of_axes > 0.8) & (of_axes < 1.25)).all(), of_axes
    # Far less than the legs scatter, and no more than noise of a single frame.
    rms = np.sqrt(np.mean((feet - made.true_feet) ** 2))
    assert rms < 0.7 * noise_m


@pytest.mark.parametrize("swing_m", [0.0, 0.03])
def test_errors_of_few_landings_are_as_stated(swing_m):
    made = landings(25, rate_hz=250, swing_m=swing_m)
    feet, feet_se = made.found()
    relative = (feet - made.true_feet) / feet_se
    assert 0.8 < np.sqrt(np.mean(relative**2)) < 1.25


MADE = landings(60)


def test_no_frame_after_the_first_contact_is_used_for_any_foot():
    feet, feet_se = MADE.found()
    spoilt = MADE.feet.copy()
    for first, crossing in zip(MADE.contacts.min(axis=1), MADE.crossing, strict=True):
        after = (MADE.time > first) & (MADE.time < crossing + 0.2)
        spoilt[after] += 1.0
    again, again_se = MADE.found([spoilt[:, [foot]] for foot in range(3)])
    np.testing.assert_array_equal(again, feet)
    np.testing.assert_array_equal(again_se, feet_se)
    before = MADE.feet.copy()
    before[MADE.time < MADE.crossing[3]] += 1.0  # frames before do matter
    moved, _ = MADE.found([before[:, [foot]] for foot in range(3)])
    assert (moved[3] - feet[3] > 0.1).any()


def test_a_foot_that_is_not_seen_is_nan_in_those_landings_only():
    feet, feet_se = MADE.found()
    hidden = MADE.feet.copy()
    hidden[:, 1] = np.nan
    near = np.abs(MADE.time - MADE.crossing[7]) < 0.3
    hidden[near, 2] = np.nan
    again, again_se = MADE.found([hidden[:, [foot]] for foot in range(3)])
    assert np.isnan(again[:, 1]).all()
    assert np.isnan(again_se[:, 1]).all()
    # The others are learned without it, and from one landing less.
    apart = (again - feet) / feet_se
    assert np.sqrt(np.mean(apart[:, 0] ** 2)) < 0.5
    unseen = np.flatnonzero(np.isnan(again[:, 2, 0]))
    np.testing.assert_array_equal(unseen, [7])
    seen = np.delete(np.arange(60), 7)
    assert np.sqrt(np.mean(apart[seen, 2] ** 2)) < 0.5


def test_a_foot_of_two_markers_is_the_one_that_is_lowest_in_most_landings():
    feet, _ = MADE.found()
    toe = MADE.feet[:, [0]]
    heel = toe + np.array([-0.05, 0.0, 0.02])
    with_heel, _ = MADE.found([np.concatenate([heel, toe], axis=1)])
    assert (np.abs(with_heel[:, 0] - feet[:, 0]) < 0.0006).all()
    lower = toe + np.array([-0.05, 0.0, -0.02])
    with_lower, _ = MADE.found([np.concatenate([lower, toe], axis=1)])
    apart = with_lower[:, 0] - feet[:, 0]
    np.testing.assert_allclose(apart[:, 2], -0.02, atol=0.0006)
    np.testing.assert_allclose(np.linalg.norm(apart[:, :2], axis=1), 0.05, atol=0.001)
