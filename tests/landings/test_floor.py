import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jumps import KINDS, NAMES, PELVIS, make
from section_fakes import hopper, on_floor

from hopdata.errors import AnalysisError
from hopdata.landings.floor import fit_floor, level, moving
from hopdata.landings.floor_raised import low_surface, raised_rests
from hopdata.landings.floor_rests import rest_points, vertical_speed
from hopdata.landings.floor_surface import (
    FloorModel,
    design,
    polynomial_terms,
    robust_regression,
)
from hopdata.landings.sections.select import select_sections
from hopdata.landings.states.assemble import assemble_pairs
from hopdata.landings.touchdowns import touchdown_table
from hopdata.maps.truth.scoring import match_landings
from hopdata.recording import Recording
from hopdata.recordings.axes import rotate_up
from hopdata.recordings.importing import import_recording
from hopdata.recordings.readers.hdf5 import read_recording, read_truth, write_recording
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis import simulate_recording

SAMPLE = Path(__file__).parents[2] / "data" / "sample" / "hopper.h5"
MOUNTS = np.array([0.012, 0.010, 0.015])


def curved(x, y):
    return 0.02 + 0.003 * x - 0.002 * y + 0.002 * x * y - 0.0015 * x**2 + 0.001 * y**3


def places(half_width=0.8, n=41):
    x, y = np.meshgrid(*[np.linspace(-half_width, half_width, n)] * 2)
    return x, y


@pytest.fixture(scope="module")
def bent():
    return on_floor(hopper(np.random.default_rng(1)).recording, curved, MOUNTS)


@pytest.fixture(scope="module")
def fitted(bent):
    return fit_floor(bent, degree=3)


def floor_error(floor, mounts=MOUNTS):
    x, y = places()
    return floor.height(x, y) - curved(x, y) - np.mean(mounts)


def test_finds_a_curved_floor_and_the_mounts(fitted):
    assert fitted.degree == 3
    assert fitted.note == ""
    assert floor_error(fitted).std() < 1e-4
    assert abs(floor_error(fitted).mean()) < 1e-4
    np.testing.assert_allclose(fitted.foot_offsets_m, MOUNTS - MOUNTS.mean(), atol=1e-4)
    assert fitted.foot_offsets_m.sum() == pytest.approx(0.0, abs=1e-15)
    assert fitted.residual_rms_m == pytest.approx(0.0006, rel=0.1)


def test_the_order_of_the_feet_does_not_matter(bent):
    markers = [2, 0, 1]
    feet = [bent.indices("foot")[i] for i in markers]
    order = bent.indices("body") + feet
    turned = replace(
        bent,
        positions=bent.positions[:, order],
        markers=tuple(bent.markers[i] for i in order),
        roles=tuple(bent.roles[i] for i in order),
    )
    ours, theirs = fit_floor(bent, max_points=500), fit_floor(turned, max_points=500)
    np.testing.assert_allclose(
        theirs.height(*places()), ours.height(*places()), rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(
        theirs.foot_offsets_m, ours.foot_offsets_m[markers], atol=1e-9
    )


def test_degree_0_cannot_follow_the_curve(bent):
    assert floor_error(fit_floor(bent, degree=0)).std() > 1e-3


def test_is_robust_where_least_squares_is_not(bent):
    rng = np.random.default_rng(2)
    x = bent.positions[:, 3, 0]
    lifted = (x > 0.3) & (rng.uniform(size=len(x)) < 0.3)
    positions = bent.positions.copy()
    positions[lifted, 3, 2] += 0.008
    floor = fit_floor(replace(bent, positions=positions))
    rest = rest_points(replace(bent, positions=positions))
    near = np.abs(rest.above_mode) < 0.02
    u = rest.points[near, :2]
    columns = [u[:, 0] ** i * u[:, 1] ** j for i in range(4) for j in range(4 - i)]
    columns += [(rest.foot[near] == k) - 1.0 * (rest.foot[near] == 2) for k in (0, 1)]
    plain = np.linalg.lstsq(np.stack(columns, 1), rest.points[near, 2], rcond=None)[0]
    error = np.abs(floor.foot_offsets_m - (MOUNTS - MOUNTS.mean())).max()
    plain_error = abs(plain[-2] - (MOUNTS[0] - MOUNTS.mean()))
    assert floor.n_outliers > 50
    assert error < 0.5 * plain_error
    assert error < 3e-4


def test_levelled_feet_rest_at_zero_and_the_body_is_over_its_own_place(bent, fitted):
    flat = level(bent, fitted)
    rest = rest_points(flat)
    low = np.abs(rest.above_mode) < 0.005
    for foot in range(3):
        height = rest.points[low & (rest.foot == foot), 2]
        assert abs(np.median(height)) < 5e-5
        assert height.std() < 7e-4
    inside = np.abs(bent.body[:, :, :2]).max(axis=(1, 2)) < 0.8
    expected = (
        bent.body[..., 2] - curved(bent.body[..., 0], bent.body[..., 1]) - MOUNTS.mean()
    )
    np.testing.assert_allclose(flat.body[inside, :, 2], expected[inside], atol=5e-4)
    np.testing.assert_array_equal(flat.positions[..., :2], bent.positions[..., :2])


def test_a_slope_and_a_shift_of_everything_are_taken_off(bent, fitted):
    tilted = on_floor(bent, lambda x, y: 0.01 * x - 0.02 * y + 1.5, np.zeros(3))
    np.testing.assert_allclose(
        level(tilted, fit_floor(tilted)).positions[..., 2],
        level(bent, fitted).positions[..., 2],
        atol=3e-4,
    )


@pytest.mark.parametrize("degrees", [2.0, 10.0])
def test_a_floor_that_slopes_by_degrees_is_told_and_fitted(bent, fitted, degrees):
    def sloping(x, y):
        return np.tan(np.deg2rad(degrees)) * (0.6 * x + 0.8 * y)

    tilted = on_floor(bent, sloping, np.zeros(3))
    floor = fit_floor(tilted)
    assert f"the floor slopes by {degrees:.1f} degrees; turn the file" in floor.note
    assert "slopes" not in fitted.note
    flat, same = level(tilted, floor).feet, level(bent, fitted).feet
    assert np.quantile(np.abs(flat - same)[..., 2], 0.99) < 1e-3


def test_where_a_sloping_floor_lies_in_the_world_does_not_matter(bent):
    """Far from the origin, position columns were nearly constant, which removed the slope."""
    tilted = on_floor(bent, lambda x, y: 0.07 * x - 0.01 * y, np.zeros(3))
    away = replace(
        tilted, positions=tilted.positions + np.array([1000.0, -1000.0, 0.0])
    )
    here, there = (fit_floor(one, degree=1) for one in (tilted, away))
    assert (there.n_points, there.degree) == (here.n_points, here.degree)
    np.testing.assert_allclose(level(away, there).feet[..., 2], level(tilted, here).feet[..., 2],
                               atol=1e-9)  # fmt: skip


def test_a_sloping_floor_under_an_animal_of_a_millimetre_is_that_under_one_of_a_metre(
    bent,
):
    tilted = on_floor(bent, lambda x, y: 0.07 * x - 0.01 * y, np.zeros(3))
    size, time_scale = 4.0**-5, 2.0**-5
    small = replace(tilted, time=time_scale * tilted.time, positions=size * tilted.positions,
                    rate_hz=tilted.rate_hz / time_scale)  # fmt: skip
    here, there = (fit_floor(one, degree=1) for one in (tilted, small))
    assert (there.n_points, there.degree) == (here.n_points, here.degree)


def test_without_noise_the_floor_is_exact():
    clean = on_floor(
        hopper(np.random.default_rng(3), noise_m=0.0).recording, curved, MOUNTS
    )
    assert np.abs(floor_error(fit_floor(clean))).max() < 1e-5


def test_gaps_stay_gaps_and_do_no_harm(bent):
    rng = np.random.default_rng(4)
    positions = bent.positions.copy()
    positions[rng.uniform(size=positions.shape[:2]) < 0.1] = np.nan
    gappy = replace(bent, positions=positions)
    floor = fit_floor(gappy)
    assert floor_error(floor).std() < 1.5e-4
    np.testing.assert_array_equal(
        np.isnan(level(gappy, floor).positions), np.isnan(positions)
    )


def test_feet_that_travel_in_stance_are_at_rest(bent):
    positions = bent.positions.copy()
    positions[..., 1] += 0.3 * np.sin(2 * np.pi * bent.time / 0.7)[:, None]
    belt = replace(bent, positions=positions)
    belt = on_floor(belt, lambda x, y: 0.002 * (x + y), np.zeros(3))
    assert fit_floor(belt).n_points > 0.8 * fit_floor(bent).n_points


@pytest.mark.parametrize("feet", [2, 6])
def test_any_number_of_feet(feet):
    mounts = np.linspace(0.01, 0.02, feet)
    recording = on_floor(
        hopper(np.random.default_rng(5), feet=feet).recording, curved, mounts
    )
    floor = fit_floor(recording)
    assert floor_error(floor, mounts).std() < 2e-4
    np.testing.assert_allclose(floor.foot_offsets_m, mounts - mounts.mean(), atol=2e-4)


def test_feet_that_keep_to_their_places_fix_no_slope():
    still = hopper(np.random.default_rng(6), arena_m=0.002, hops=60).recording
    floor = fit_floor(on_floor(still, lambda x, y: 0.0 * (x + y), MOUNTS))
    assert (floor.degree, floor.degree_wanted) == (0, 5)
    assert "degree 5" in floor.note
    np.testing.assert_allclose(floor.foot_offsets_m, MOUNTS - MOUNTS.mean(), atol=1e-4)


def test_fewer_steps_fix_a_lower_degree():
    degrees = [
        fit_floor(
            on_floor(
                hopper(np.random.default_rng(7), hops=hops).recording, curved, MOUNTS
            )
        ).degree
        for hops in (4, 300)
    ]
    assert degrees[0] < 3
    assert degrees[1] == 5


def test_the_degree_is_lowered_to_meet_the_error_asked_for(bent):
    assert fit_floor(bent, degree=6, largest_error_m=1e-4).degree < 6
    assert fit_floor(bent, degree=6, largest_error_m=1e-2).degree == 6


def test_beyond_the_rim_the_floor_keeps_the_value_of_the_rim(fitted):
    angle = np.linspace(0, 2 * np.pi, 50)
    x, y = np.cos(angle), np.sin(angle)
    cx, cy = fitted.centre_m
    far = fitted.height(cx + 1e3 * x, cy + 1e3 * y)
    np.testing.assert_allclose(far, fitted.height(cx + 3 * x, cy + 3 * y), atol=1e-12)
    assert np.ptp(far) < 0.02
    inner = fitted.height(cx + 0.5 * x, cy + 0.5 * y)
    ahead, aside = fitted.axis
    u = 0.5 * (ahead * x + aside * y) / fitted.scale_m
    v = 0.5 * (ahead * y - aside * x) / fitted.scale_m
    powers = [(u**i, v**j) for i, j in fitted.terms]
    expected = sum(
        c * u * v for c, (u, v) in zip(fitted.coefficients_m, powers, strict=True)
    )
    np.testing.assert_allclose(inner, expected, atol=1e-12)


def test_heights_have_the_shape_of_the_places_and_their_gaps(fitted):
    x = np.array([[0.0, np.nan, 0.2], [0.1, 0.2, 0.3]])
    height = fitted.height(x, 0.0)
    assert height.shape == (2, 3)
    np.testing.assert_array_equal(np.isnan(height), np.isnan(x))
    assert fitted.height(np.empty((0, 4)), np.empty((0, 4))).shape == (0, 4)


def test_disabled_leaves_heights_and_still_reports(bent):
    floor = fit_floor(bent, enabled=False)
    np.testing.assert_array_equal(level(bent, floor).positions, bent.positions)
    assert "not compensated" in floor.note
    assert floor.n_points > 1000
    assert floor.n_outliers == 0
    assert (floor.degree, floor.degree_wanted) == (0, fit_floor(bent).degree_wanted)
    assert floor.residual_rms_m > 0.02


def test_goes_through_json(bent, fitted):
    again = FloorModel.from_dict(json.loads(json.dumps(fitted.to_dict())))
    x, y = places(2.0)
    np.testing.assert_array_equal(again.height(x, y), fitted.height(x, y))
    assert again.to_dict() == fitted.to_dict()
    nothing = replace(bent, positions=np.full_like(bent.positions, np.nan))
    empty = fit_floor(nothing, enabled=False)
    assert empty.to_dict()["residual_rms_m"] is None
    assert np.isnan(FloorModel.from_dict(empty.to_dict()).residual_rms_m)


def test_names_the_foot_that_is_never_at_rest(bent):
    positions = bent.positions.copy()
    positions[:, 4, 2] += (10.0 * bent.time) % 0.7
    with pytest.raises(
        AnalysisError, match=r"floor: f2 hardly ever at rest.*rest_speed_m_s"
    ):
        fit_floor(replace(bent, positions=positions))


def test_level_wants_the_same_feet(bent, fitted):
    with pytest.raises(ValueError, match="feet: expected"):
        level(bent, replace(fitted, feet=("a", "b", "c")))


def test_vertical_speed_is_exact_on_a_parabola_and_nan_at_gaps():
    time = np.arange(50) / 100
    height = 2 * time - 4.905 * time**2
    height[20] = np.nan
    speed = vertical_speed(time, height, lag=2)
    expected = 2 - 9.81 * time
    expected[[0, 1, 18, 20, 22, 48, 49]] = np.nan
    np.testing.assert_allclose(speed, expected, atol=1e-12)
    assert np.isnan(vertical_speed(time[:3], height[:3], lag=2)).all()


def test_sample_floor_against_its_truth():
    recording, truth = read_recording(SAMPLE), read_truth(SAMPLE)
    floor = fit_floor(recording)
    seen = np.isfinite(truth.contact_times)
    error = floor.height(truth.contact_points[..., 0], truth.contact_points[..., 1])
    error = (error - truth.floor_at_contacts)[seen]
    assert np.sqrt(np.mean((error - error.mean()) ** 2)) < 3e-4
    flat = truth.floor_at_contacts[seen]
    assert flat.std() > 3 * error.std()


@pytest.mark.filterwarnings("error")
def test_regressions_are_those_of_statsmodels():
    import statsmodels.api as sm

    rng = np.random.default_rng(3)
    columns = np.column_stack([np.ones(900), rng.uniform(-1, 1, (900, 5))])
    heights = columns @ rng.normal(0, 0.01, 6) + rng.normal(0, 5e-4, 900)
    heights[::4] += rng.exponential(0.02, 225)  # feet that hang
    robust = sm.RLM(1e3 * heights, columns, M=sm.robust.norms.TukeyBiweight())
    found = robust.fit(conv="coefs", tol=1e-10, maxiter=300).params / 1e3
    np.testing.assert_allclose(
        robust_regression(columns, heights), found, rtol=0, atol=1e-12
    )
    low = sm.QuantReg(heights, columns).fit(q=0.05, max_iter=300).params
    np.testing.assert_allclose(low_surface(heights, columns), low, rtol=0, atol=2e-5)


def test_a_perfect_fit_is_silent():
    flat = hopper(np.random.default_rng(6), noise_m=0.0).recording
    rounded = flat.positions.round(4)
    floor = fit_floor(replace(flat, positions=rounded))
    assert np.abs(floor.height(*rounded[::50, 3, :2].T)).max() < 1e-4


@pytest.mark.parametrize("height_m", [0.008, 0.015])
def test_a_foot_that_hangs_low_for_half_of_the_run_does_no_harm(bent, height_m):
    positions = bent.positions.copy()
    low = positions[:, 3, 2] - curved(*positions[:, 3, :2].T) - MOUNTS[0] < 0.003
    positions[low & (bent.time > 0.5 * bent.time[-1]), 3, 2] += height_m
    floor = fit_floor(replace(bent, positions=positions))
    assert floor_error(floor).std() < 2e-4
    np.testing.assert_allclose(floor.foot_offsets_m, MOUNTS - MOUNTS.mean(), atol=2e-4)
    assert "f1 rests above the floor" in floor.note
    assert floor.n_outliers > 0.1 * floor.n_points


def test_the_order_of_the_feet_changes_nothing(bent):
    """Not even where points are thinned and a foot hangs low, so that many are left out."""
    positions = bent.positions.copy()
    low = positions[:, 3, 2] - curved(*positions[:, 3, :2].T) - MOUNTS[0] < 0.003
    positions[low & (bent.time > 0.5 * bent.time[-1]), 3, 2] += 0.015
    hanging = replace(bent, positions=positions)
    feet, others = (
        bent.indices("foot"),
        [k for k, r in enumerate(bent.roles) if r != "foot"],
    )
    columns = [*others, *feet[::-1]]
    turned_round = replace(
        hanging,
        positions=positions[:, columns],
        markers=tuple(bent.markers[k] for k in columns),
        roles=tuple(bent.roles[k] for k in columns),
    )
    one, other = fit_floor(hanging), fit_floor(turned_round)
    x, y = places()
    np.testing.assert_allclose(other.height(x, y), one.height(x, y), rtol=0, atol=1e-12)
    assert (other.n_points, other.n_outliers) == (one.n_points, one.n_outliers)


# Two, four and six feet, at 50 to 2000 Hz, with any axis pointing up, against the
# truth.

THREE = HopperParameters()
BODY = [f"body{k + 1}" for k in range(8)]


def floor_of_jumps(kind, seed, rate_hz, *, jumps=2):
    """Return the floor under some jumps, seen at this rate, 1/s."""
    seen, _ = make(KINDS[kind], jumps, np.random.default_rng(seed), rate_hz, 5e-4)
    feet, time = ["LTOE", "LHEE", "RTOE", "RHEE"], np.arange(len(seen)) / rate_hz
    return fit_floor(Recording.from_arrays(time, seen, NAMES, feet=feet, body=PELVIS))


@pytest.mark.parametrize("seed", [0, 5, 37])
def test_a_mat_that_gives_at_one_landing_of_two_is_not_the_floor(seed):
    floor = floor_of_jumps("box, begins in the air, soft 8 ms", seed, 120.0)
    rests = floor.coefficients_m[0] + floor.foot_offsets_m
    np.testing.assert_allclose(rests, [0.025, 0.04, 0.025, 0.04], atol=0.002)


@pytest.mark.parametrize("seed", range(3))
def test_a_box_on_which_the_feet_stand_longest_is_not_the_floor(seed):
    floor = floor_of_jumps("box, ends in the landing", seed, 200.0)
    assert floor.coefficients_m[0] == pytest.approx(0.0325, abs=0.01)


MOTIONS = {
    "rises": lambda t: 0.02 * t / t[-1],
    "sways": lambda t: 0.01 * np.sin(2 * np.pi * t / 7),
    "sways far": lambda t: 0.05 * np.sin(2 * np.pi * t / 20),
    "gives way": lambda t: np.where(t > t[-1] / 2, -0.05, 0.0),
}


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_floor_that_moves_is_told_and_followed(bent, fitted, motion):
    moved = MOTIONS[motion](bent.time)
    up = moved[:, None, None] * np.array([0.0, 0.0, 1.0])
    moving_deck = replace(bent, positions=bent.positions + up)
    (told,) = re.findall(
        r"floor moves: .* together by (\d+) mm; hopdata uses", moving(moving_deck)
    )
    assert float(told) == pytest.approx(
        1e3 * np.subtract(*np.quantile(moved, [0.95, 0.05])), rel=0.1
    )
    floor = fit_floor(moving_deck, degree=3)
    assert floor.note.startswith(moving(moving_deck))
    stands = bent.feet[:, :, 2].min(axis=1) < 0.025
    off = level(moving_deck, floor).feet[stands] - level(bent, fitted).feet[stands]
    assert np.quantile(np.abs(off[..., 2]), 0.95) < 0.002
    again = FloorModel.from_dict(json.loads(json.dumps(floor.to_dict())))
    np.testing.assert_array_equal(again.moved_m, floor.moved_m)


@pytest.mark.parametrize("seed", range(5))
def test_feet_that_stand_for_a_tenth_of_a_second_show_that_the_floor_sinks_and_turns(
    seed,
):
    rng, hop_s = np.random.default_rng(seed), 0.35
    time = np.arange(0, 30, 1 / 200)
    hop = (time / hop_s).astype(int)
    s = time - hop_s * hop
    up = np.where(s < 0.09, 0.0, 4.9 * (s - 0.09) * (hop_s - s))
    walk = np.cumsum(rng.normal(0, 0.05, (hop[-1] + 1, 2)), axis=0)[hop]
    angle = 2 * np.pi * np.arange(3) / 3
    feet = walk[:, None] + 0.16 * np.column_stack([np.cos(angle), np.sin(angle)])
    floor = -0.04 * time[:, None] / 30 + 0.01 * time[:, None] / 30 * feet[..., 0]
    markers = np.dstack([feet, floor + up[:, None]])
    positions = np.hstack([markers, markers + np.array([0.0, 0.0, 0.4])])
    positions += rng.normal(0, 3e-4, positions.shape)
    recording = Recording.from_arrays(
        time,
        positions,
        list("abcdef"),
        feet=list("abc"),
        body=list("def"),
        name="sinks",
    )
    assert "floor moves" in moving(recording)
    heights = level(recording, fit_floor(recording)).feet[(s > 0.03) & (s < 0.07), :, 2]
    assert np.std(heights) < 6e-4


@pytest.mark.parametrize("when", ["slowly", "at once"])
def test_a_floor_that_turns_is_told(bent, when):
    share = bent.time / bent.time[-1]
    slope = 0.035 * share if when == "slowly" else 0.0175 * (share > 0.6)
    turned = bent.positions.copy()
    turned[..., 2] += slope[:, None] * turned[..., 1]
    deck = replace(bent, positions=turned)
    (told,) = re.findall(r"the floor is tilted by (\d\.\d) degrees", moving(deck))
    assert float(told) == pytest.approx(1.0, abs=0.2)
    assert moving(deck) in fit_floor(deck, degree=3).note


def test_a_floor_that_stays_is_not_followed(bent):
    slope = bent.positions.copy()
    slope[..., 2] += 0.15 * slope[..., 0] - 0.01 * slope[..., 1] ** 2
    assert moving(bent) == moving(replace(bent, positions=slope)) == ""


def test_one_foot_that_slips_up_is_no_floor_that_moves(bent):
    slipped = bent.positions.copy()
    slipped[len(slipped) // 2 :, bent.indices("foot")[0], 2] += 0.02
    assert moving(replace(bent, positions=slipped)) == ""


def test_feet_that_roll_alike_are_no_floor_that_moves(bent):
    rolled = bent.positions.copy()
    later = slice(4 * len(rolled) // 5, None)
    for foot, rise_m in zip(bent.indices("foot"), (0.008, 0.010, 0.013), strict=True):
        rolled[later, foot, 2] += rise_m
    assert moving(replace(bent, positions=rolled)) == ""


def test_feet_that_are_held_and_let_go_are_no_floor_that_moves():
    rng = np.random.default_rng(np.random.SeedSequence(8))
    second, height = np.linspace(0.0, 1.0, 100, endpoint=False), [np.zeros(100)]
    for held_m in rng.uniform(
        0.06, 0.14, 30
    ):  # lifted slowly, held, released, then standing
        fall = held_m - 0.5 * 9.81 * second**2
        height += [held_m * second, np.full(100, held_m), np.maximum(fall, 0.0)]
    z = np.concatenate(height)
    positions = rng.normal(scale=5e-4, size=(len(z), 6, 3)) + z[:, None, None] * [
        0.0,
        0.0,
        1.0,
    ]
    positions += [
        *([0.2 * k, 0.1 * k**2, 0.0] for k in range(3)),
        *([[0.1, 0.1, 0.4]] * 3),
    ]
    names = ["a", "b", "c", "d", "e", "f"]
    time = 0.01 * np.arange(len(z))
    held = Recording.from_arrays(time, positions, names, feet=names[:3], body=names[3:])
    rest = rest_points(held)
    assert rest.let_go.any()
    assert (rest.above_mode[rest.let_go] > 0.01).all()
    assert moving(held) == ""


@pytest.mark.parametrize("kind", ["series", "series, soft 8 ms"])
def test_soles_that_give_are_no_floor_that_moves(kind):
    assert "moves" not in floor_of_jumps(kind, 3, 200.0, jumps=11).note


def simulate(feet, *, hops=40, rate_hz=100.0, markers=3, seed=8):
    """Simulate legs with the strength of three together; a biped is dropped for every landing."""
    share = 3 / feet
    hopper = {
        name: share * getattr(THREE, name)
        for name in ("stiffness_n_m", "damping_n_s_m", "preload_n")
    }
    simulation = {"hops": hops, "hopper": {"n_legs": feet, **hopper}}
    if feet == 2:
        simulation["operator"] = {"arena_m": 1e-6, "carry_s": 0.5}
    angle = 2 * np.pi * np.arange(markers) / markers
    heights = 0.06 + 0.02 * np.cos(2 * angle)
    body = np.column_stack([0.14 * np.cos(angle), 0.14 * np.sin(angle), heights])
    camera = {"rate_hz": rate_hz, "markers": {"body_m": body.tolist()}}
    return simulate_recording(simulation, camera, seed=seed)


def touchdowns(recording):
    """Return the levelled recording, sections and table of touchdowns."""
    flat = level(recording, fit_floor(recording))
    sections = select_sections([flat])
    heights = {
        "pre_height_m": sections.pre_height_m,
        "post_height_m": sections.post_height_m,
    }
    return flat, heights, touchdown_table(flat, **heights)


def contacts(table):
    return table.filter(regex="^contact_.*_s$").to_numpy()


def errors_and_gaps(table, truth):
    """Return errors of used instants, s, whether each order is right, and its closest pair, s."""
    used = table[~table["excluded"]]
    landing = match_landings(contacts(used), truth.contact_times)
    assert (landing >= 0).all(), "a touchdown that never was"
    true = truth.contact_times[landing]
    right = (np.argsort(contacts(used), axis=1) == np.argsort(true, axis=1)).all(axis=1)
    return contacts(used) - true, right, np.diff(np.sort(true, axis=1)).min(axis=1)


@pytest.mark.parametrize(
    ("feet", "rate_hz", "rms_ms"),
    [(2, 100, 0.5), (4, 500, 0.3), (6, 100, 0.6), (6, 50, 1.0), (2, 2000, 0.2)],
)
def test_instants_and_orders_are_those_of_the_truth(feet, rate_hz, rms_ms):
    hops = 40 if rate_hz <= 100 else 15
    recording, truth = simulate(feet, hops=hops, rate_hz=rate_hz)
    _, _, table = touchdowns(recording)
    assert (~table["excluded"]).sum() >= 0.8 * hops
    assert table.loc[table["excluded"], "reason"].ne("").all()
    error, right, closest = errors_and_gaps(table, truth)
    assert 1e3 * (error - error.mean()).std() < rms_ms
    assert right[closest > 4e-3 * rms_ms].all(), (
        "contacts further apart than four errors"
    )
    schedules = table.loc[~table["excluded"], "schedule"]
    assert schedules.str.count(">").eq(feet - 1).all()
    assert schedules.map(lambda name: sorted(name.split(">"))).str.len().eq(feet).all()


@pytest.fixture(scope="module")
def many_markers():
    return simulate(6, hops=15, markers=8)[0]


@pytest.mark.parametrize("markers", [3, 5, 8])
def test_any_number_of_body_markers_gives_states(many_markers, markers):
    kept = [
        k
        for k, name in enumerate(many_markers.markers)
        if name not in BODY or name in BODY[:markers]
    ]
    fewer = replace(
        many_markers,
        positions=many_markers.positions[:, kept],
        markers=tuple(many_markers.markers[k] for k in kept),
        roles=tuple(many_markers.roles[k] for k in kept),
    )
    flat, heights, table = touchdowns(fewer)
    pairs = assemble_pairs([flat], table, home_marker="body1", **heights)
    assert pairs.x.shape[1] == pairs.y.shape[1] == 6 * markers
    assert len(pairs.x) >= 10
    assert np.isfinite(pairs.x).all()


@pytest.mark.parametrize("axis", ["x", "y", "-x", "-y", "-z"])
def test_the_vertical_axis_of_the_file_changes_nothing(axis, tmp_path):
    recording, _ = simulate(2, hops=15)
    turn = rotate_up(np.eye(3), axis)  # rows: directions of the file's axes
    markers = {"body": recording.names("body"), "feet": recording.names("foot")}
    tables = {}
    for name, file in {
        "z": recording,
        axis: replace(
            recording, positions=np.ascontiguousarray(recording.positions @ turn.T)
        ),
    }.items():
        write_recording(tmp_path / f"{name}.h5", file, None)
        read, _ = import_recording(
            tmp_path / f"{name}.h5", name="one", markers=markers, vertical_axis=name
        )
        tables[name] = touchdowns(read)[2]
    assert len(tables["z"]) >= 14
    assert tables["z"].equals(tables[axis])


def test_a_gap_of_a_few_milliseconds_at_a_section_costs_no_landing():
    recording, _ = simulate(4, hops=8, rate_hz=1000)
    flat, heights, table = touchdowns(recording)
    first = table[~table["excluded"]].iloc[0]
    hidden, lost = flat.positions.copy(), flat.positions.copy()
    at = np.searchsorted(flat.time, first["t_pre_s"])
    hidden[at - 3 : at + 3, flat.indices("body")] = np.nan  # 7 ms from frame to frame
    lost[at - 20 : at + 20, flat.indices("body")] = np.nan  # 41 ms
    again = touchdown_table(replace(flat, positions=hidden), **heights)
    assert again["excluded"].equals(table["excluded"])
    assert abs(again["t_pre_s"] - table["t_pre_s"]).max() < 1e-3
    refused = touchdown_table(replace(flat, positions=lost), **heights)
    assert (
        refused["reason"][first["touchdown"] - 1] == "frames missing at the pre section"
    )


NOISE_M, BAND_M = 0.0006, 0.02


def ground(n=3000, seed=0):
    """Return rests of three feet on a curved floor: heights, columns, feet and positions."""
    rng = np.random.default_rng(seed)
    places, foot = rng.uniform(-1, 1, (n, 2)), np.arange(n) % 3
    contrasts = np.vstack([np.eye(2), [[-1.0, -1.0]]])
    columns = np.hstack([design(places, polynomial_terms(4)), contrasts[foot]])
    heights = (
        0.003 * places[:, 0] ** 2
        - 0.002 * places[:, 1]
        + [0.001, 0.0, -0.001] @ np.eye(3)[:, foot]
    )
    return heights + NOISE_M * rng.standard_normal(n), columns, foot, places


def test_nothing_is_raised_on_a_clean_floor():
    heights, columns, _, _ = ground()
    assert not raised_rests(heights, columns, band_m=BAND_M).any()


@pytest.mark.parametrize("share", [0.1, 0.4, 0.7])
@pytest.mark.parametrize("height_m", [0.006, 0.015])
def test_finds_a_foot_that_hangs_low_even_more_often_than_not(share, height_m):
    heights, columns, foot, _ = ground()
    hangs = (foot == 0) & (np.arange(len(foot)) > (1 - share) * len(foot))
    heights[hangs] += height_m
    found = raised_rests(heights, columns, band_m=BAND_M)
    assert (found == hangs).mean() > 0.998


def test_finds_a_board_that_a_polynomial_could_follow():
    heights, columns, _, places = ground()
    board = np.hypot(places[:, 0] - 0.2, places[:, 1]) < 0.5
    heights[board] += 0.01
    assert board.mean() > 0.15
    assert (raised_rests(heights, columns, band_m=BAND_M) == board).mean() > 0.998


def test_a_few_are_left_to_the_regression():
    heights, columns, _, _ = ground()
    heights[:30] += 0.01
    assert not raised_rests(heights, columns, band_m=BAND_M).any()


def test_what_is_far_away_is_no_foot_at_rest():
    heights, columns, _, _ = ground()
    heights[:600] += 0.3
    found = raised_rests(heights, columns, band_m=BAND_M)
    assert not found[600:].any()


def test_too_few_points_say_nothing():
    heights, columns, _, _ = ground(n=18)
    assert not raised_rests(heights, columns, band_m=BAND_M).any()


@pytest.mark.filterwarnings("error")
def test_without_noise_it_is_silent():
    _, columns, foot, _ = ground()
    flat = np.where(foot == 0, 0.01, 0.0)
    assert not raised_rests(flat, columns, band_m=BAND_M).any()
    flat[::3][:300] += 0.01
    assert raised_rests(flat, columns, band_m=BAND_M).sum() == 300


@pytest.mark.parametrize("axis", [0, 1])
def test_a_slope_along_either_axis_loses_no_rest(bent, fitted, axis):
    slope = 0.25 * bent.positions[..., axis : axis + 1]
    tilted = replace(bent, positions=bent.positions + np.array([0, 0, 1.0]) * slope)
    floor = fit_floor(tilted)
    assert floor.n_points == pytest.approx(fitted.n_points, rel=0.05)
    assert [message.code for message in floor.messages] == ["landings.floor_slopes"]


def test_what_a_floor_says_is_data_that_goes_through_json(bent):
    tilted = bent.positions + np.array([0, 0, 1.0]) * 0.05 * bent.positions[..., :1]
    floor = fit_floor(replace(bent, positions=tilted))
    assert [message.code for message in floor.messages] == ["landings.floor_slopes"]
    assert floor.messages[0].values["degrees"] == pytest.approx(2.9, abs=0.5)
    assert floor.slopes
    assert not floor.moves
    stored = json.loads(json.dumps(floor.to_dict()))
    assert stored["note"] == floor.note == floor.messages[0].text()
    again = FloorModel.from_dict(stored)
    assert again.messages == floor.messages
    # Files of earlier versions have only the words.
    del stored["messages"]
    assert FloorModel.from_dict(stored).note == floor.note
    assert not fit_floor(bent).slopes
