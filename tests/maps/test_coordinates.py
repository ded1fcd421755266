from itertools import combinations_with_replacement, permutations

import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.maps.coordinates import (
    foot_sets,
    kink_slopes,
    kinks,
    monomials,
    output_weights,
    rigid_states,
    section_coordinates,
)
from hopdata.rigid import INPUT_NAMES, OUTPUT_NAMES, body_shape, kabsch

SHAPE = np.array([[0.13, 0.03, -0.01], [-0.07, 0.11, 0.02], [-0.06, -0.14, -0.01]])


def rotations(yaw, pitch, roll):
    """Return rotations Rz(yaw) Ry(pitch) Rx(roll), (n, 3, 3)."""
    return _about(2, yaw) @ _about(1, pitch) @ _about(0, roll)


def _about(axis, angle):
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.zeros((len(angle), 3, 3))
    rotation[:, axis, axis] = 1.0
    rotation[:, i, i] = rotation[:, j, j] = np.cos(angle)
    rotation[:, j, i], rotation[:, i, j] = np.sin(angle), -np.sin(angle)
    return rotation


def markers(centre, rotation, velocity, spin, shape=SHAPE):
    """Return states (n, 6B) of a body whose angular velocity in its own axes is `spin`."""
    arms = np.einsum("nij,bj->nbi", rotation, shape)
    slips = np.einsum("nij,nbj->nbi", rotation, np.cross(spin[:, None], shape[None]))
    positions, velocities = centre[:, None] + arms, velocity[:, None] + slips
    return np.concatenate([positions, velocities], axis=1).reshape(len(centre), -1)


def motions(n=50, seed=3, tilt=0.3):
    rng = np.random.default_rng(seed)
    angles = (
        rng.uniform(-3, 3, n),
        rng.uniform(-tilt, tilt, n),
        rng.uniform(-tilt, tilt, n),
    )
    centre, velocity, spin = rng.standard_normal((3, n, 3))
    return centre, rotations(*angles), velocity, spin, angles


@pytest.mark.parametrize("n_markers", [3, 4, 7])
def test_place_attitude_and_motion_are_found_exactly(n_markers):
    shape = np.random.default_rng(5).standard_normal((n_markers, 3))
    shape -= shape.mean(axis=0)
    centre, rotation, velocity, spin, _ = motions()
    found = rigid_states(markers(centre, rotation, velocity, spin, shape), shape)
    np.testing.assert_allclose(found.centre, centre, atol=1e-13)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-13)
    np.testing.assert_allclose(found.velocity, velocity, atol=1e-13)
    np.testing.assert_allclose(found.spin, spin, atol=1e-12)


def test_kabsch_gives_rotations_and_never_a_reflection():
    rng = np.random.default_rng(8)
    flat = SHAPE * [1, 1, 0]
    points = np.einsum("nij,bj->nbi", motions()[1], flat) + 0.05 * rng.standard_normal(
        (50, 3, 3)
    )
    found = kabsch(
        points - points.mean(axis=1, keepdims=True), flat - flat.mean(axis=0)
    )
    np.testing.assert_allclose(np.linalg.det(found), 1.0, atol=1e-12)
    np.testing.assert_allclose(found @ found.transpose(0, 2, 1), np.eye(3)[None] + 0 * found,
                               atol=1e-12)  # fmt: skip


def test_no_other_rotation_brings_noisy_points_nearer():
    rng = np.random.default_rng(9)
    points = np.einsum("nij,bj->nbi", motions()[1], SHAPE) + 0.01 * rng.standard_normal(
        (50, 3, 3)
    )
    points -= points.mean(axis=1, keepdims=True)
    best = kabsch(points, SHAPE)

    def misses(rotation):
        return np.sum(
            (points - np.einsum("nij,bj->nbi", rotation, SHAPE)) ** 2, axis=(1, 2)
        )

    for _ in range(20):
        nearby = best @ rotations(*(0.02 * rng.standard_normal((3, 50))))
        assert (misses(nearby) >= misses(best) - 1e-14).all()


def test_the_shape_is_found_from_noisy_attitudes():
    rng = np.random.default_rng(4)
    centre, rotation, *_ = motions(4000)
    points = centre[:, None] + np.einsum("nij,bj->nbi", rotation, SHAPE)
    shape = body_shape(points + 1e-3 * rng.standard_normal(points.shape))
    assert np.abs(shape.mean(axis=0)).max() < 1e-12
    sides = [np.linalg.norm(s - np.roll(s, 1, axis=0), axis=1) for s in (shape, SHAPE)]
    np.testing.assert_allclose(*sides, atol=2e-4)


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        (np.outer([-0.1, 0.03, 0.07], [1.0, 2.0, 0.5]), "not on one line"),
        (np.zeros((3, 3)), "not on one line"),
        (
            SHAPE[:2] - SHAPE[:2].mean(axis=0),
            "at least 3 body markers are needed, found 2",
        ),
    ],
)
def test_markers_that_fix_no_attitude_are_refused(shape, words):
    points = np.einsum("nij,bj->nbi", motions()[1], shape)
    with pytest.raises(AnalysisError, match=words):
        body_shape(points)


def test_section_coordinates_are_the_ones_that_made_the_motion():
    centre, rotation, velocity, spin, (yaw, pitch, roll) = motions()
    still = markers(centre, rotation, velocity, spin)
    state = rigid_states(still, SHAPE)
    x, y = section_coordinates(state, state)
    assert (x.shape[1], y.shape[1]) == (len(INPUT_NAMES), len(OUTPUT_NAMES)) == (8, 11)
    np.testing.assert_allclose(x[:, :2], np.column_stack([pitch, roll]), atol=1e-12)
    forward = velocity[:, 0] * np.cos(yaw) + velocity[:, 1] * np.sin(yaw)
    np.testing.assert_allclose(x[:, 2], forward, atol=1e-12)
    np.testing.assert_allclose(x[:, 4], velocity[:, 2], atol=1e-12)
    np.testing.assert_allclose(x[:, 5:], spin, atol=1e-11)
    np.testing.assert_allclose(y[:, :3], 0.0, atol=1e-12)
    np.testing.assert_allclose(y[:, 3:], x, atol=1e-12)


def test_a_step_and_a_turn_are_seen_from_the_state_before():
    n = 20
    rng = np.random.default_rng(6)
    zero, yaw, turn = np.zeros(n), rng.uniform(-3, 3, n), rng.uniform(-0.5, 0.5, n)
    still = np.zeros((n, 3))
    step = rng.standard_normal((n, 2))
    c, s = np.cos(yaw), np.sin(yaw)
    moved = np.column_stack(
        [c * step[:, 0] - s * step[:, 1], s * step[:, 0] + c * step[:, 1]]
    )
    before = markers(still, rotations(yaw, zero, zero), still, still)
    after = markers(
        np.column_stack([moved, zero]), rotations(yaw + turn, zero, zero), still, still
    )
    y = section_coordinates(rigid_states(before, SHAPE), rigid_states(after, SHAPE))[1]
    np.testing.assert_allclose(y[:, :3], np.column_stack([step, turn]), atol=1e-12)


def test_nothing_changes_if_each_landing_is_moved_and_turned_in_the_plane():
    rng = np.random.default_rng(7)
    n = 50
    pre, post = motions(n, 1), motions(n, 2)
    turn = rotations(rng.uniform(-3, 3, n), np.zeros(n), np.zeros(n))
    shift = np.column_stack([rng.standard_normal((n, 2)), np.zeros(n)])
    pairs = []
    for moved in (False, True):
        states = []
        for centre, rotation, velocity, spin, _ in (pre, post):
            if moved:
                centre = np.einsum("nij,nj->ni", turn, centre) + shift
                velocity = np.einsum("nij,nj->ni", turn, velocity)
                rotation = turn @ rotation
            states.append(
                rigid_states(markers(centre, rotation, velocity, spin), SHAPE)
            )
        pairs.append(section_coordinates(*states))
    for one, other in zip(*pairs, strict=True):
        np.testing.assert_allclose(other, one, atol=1e-11)


@pytest.mark.parametrize("column", range(11))
def test_outputs_count_by_the_rms_way_of_the_markers(column):
    """A small change of one output changes the markers' places or speeds by its weight."""
    small, unit = 1e-6, 0.027
    value = np.zeros((1, 11))
    value[0, column] = small
    rotation = rotations(value[:, 2], value[:, 3], value[:, 4])
    centre = np.column_stack([value[:, :2], [0.0]])
    moved = markers(centre, rotation, value[:, 5:8], value[:, 8:]).reshape(2, 3, 3)
    moved[0] -= SHAPE
    rms = np.sqrt((moved**2).sum(axis=2).mean(axis=1)) / small
    assert output_weights(SHAPE, unit)[column] == pytest.approx(
        rms[0] + unit * rms[1], rel=1e-5
    )


# The kinks, and products of inputs.


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.mark.parametrize(("feet", "number"), [(2, 1), (3, 4), (4, 6), (6, 15)])
def test_number_of_kinks(feet, number):
    assert len(foot_sets(feet)) == number


@pytest.mark.parametrize("feet", [2, 3, 4])
def test_slopes_of_the_kinks_are_their_derivatives(feet):
    for order in permutations(range(feet)):
        t = np.argsort(order) * 1.0
        steps = np.array(
            [
                (kinks((t + e)[None]) - kinks((t - e)[None]))[0] / 2e-3
                for e in 1e-3 * np.eye(feet)
            ]
        )
        assert np.allclose(steps.T, kink_slopes(order), atol=1e-9)


def test_every_continuous_function_linear_on_each_order_is_a_sum_of_kinks(rng):
    """Values at the six rays (one foot first, or one foot last) are free; between, linear."""
    rays = np.array(
        [np.eye(3)[k] - 1 / 3 for k in range(3)]
        + [1 / 3 - np.eye(3)[k] for k in range(3)]
    )
    design = np.column_stack([kinks(rays), rays[:, :2]])
    assert np.linalg.matrix_rank(design) == 6
    values = rng.standard_normal(6)
    weights = np.linalg.solve(design, values)
    middle = rays[0] + rays[5]  # between neighbouring rays, inside one order
    found = np.concatenate([kinks(middle[None])[0], middle[:2]]) @ weights
    assert found == pytest.approx(values[0] + values[5])


def test_monomials_are_products_of_columns(rng):
    x = rng.standard_normal((7, 4))
    expected = [
        np.prod(x[:, list(chosen)], axis=1)
        for degree in (1, 3)
        for chosen in combinations_with_replacement(range(4), degree)
    ]
    np.testing.assert_array_equal(monomials(x, (1, 3)), np.column_stack(expected))
