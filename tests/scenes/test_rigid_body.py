import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hopdata.scenes.rigid_body import (
    cross,
    euler_rates,
    rotation_entries,
    rotation_matrices,
    solve_with_point_mass,
)


@pytest.fixture
def rng():
    return np.random.default_rng(1)


def test_rotation_is_yaw_pitch_roll_from_body_to_world(rng):
    angles = rng.uniform(-1.4, 1.4, (20, 3))
    oracle = Rotation.from_euler("ZYX", angles).as_matrix()
    np.testing.assert_allclose(rotation_matrices(angles), oracle, atol=1e-15)
    entries = [rotation_entries.py_func(*a) for a in angles]
    np.testing.assert_allclose(np.reshape(entries, (20, 3, 3)), oracle, atol=1e-15)


def test_the_order_of_the_angles_matters(rng):
    angles = rng.uniform(0.5, 1.0, (5, 3))
    other = Rotation.from_euler("XYZ", angles[:, ::-1]).as_matrix()
    assert np.abs(rotation_matrices(angles) - other).max() > 0.1


def test_euler_rates_turn_the_body_at_its_angular_velocity(rng):
    step = 1e-6
    for _ in range(10):
        angles, w = rng.uniform(-1.2, 1.2, 3), rng.normal(size=3)
        rates = np.array(euler_rates.py_func(*angles[1:], *w))
        ahead, behind = (rotation_matrices(angles + s * step * rates) for s in (1, -1))
        spin = rotation_matrices(angles).T @ (ahead - behind) / (2 * step)
        np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], w, atol=1e-8)


def test_cross_product(rng):
    a, b = rng.normal(size=(2, 3))
    np.testing.assert_allclose(cross.py_func(*a, *b), np.cross(a, b), rtol=1e-15, atol=1e-15)


def test_solve_with_point_mass_solves_the_full_matrix(rng):
    inertia, c, b = rng.uniform(0.05, 0.2, 3), rng.normal(size=3), rng.normal(size=3)
    matrix = np.diag(inertia) + 0.7 * (c @ c * np.eye(3) - np.outer(c, c))
    found = solve_with_point_mass.py_func(*inertia, 0.7, tuple(c), tuple(b))
    np.testing.assert_allclose(found, np.linalg.solve(matrix, b), rtol=1e-12)
