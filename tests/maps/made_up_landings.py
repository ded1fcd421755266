"""Landings of a made-up rigid body whose map from section to section is known."""

import numpy as np

from hopdata.maps.affine import errors_by
from hopdata.maps.truth.maps import marker_states

POINTS = np.array([(0.13, 0.03, 0.05), (-0.08, 0.11, 0.075), (-0.07, -0.14, 0.055)])
ARMS = POINTS - POINTS.mean(axis=0)
MIDDLE = np.array([0.02, -0.01, 0.1, 0.05, -1.6, 0.0, 0.0, 0.1])
SPREAD = np.array([0.04, 0.04, 0.07, 0.07, 0.08, 0.3, 0.3, 0.25])
END = np.array([0.02, 0.0, 0.0, 0.01, 0.0, 0.1, 0.0, -1.0, 0.0, 0.0, 0.0])
CONTACTS = np.random.default_rng(2).normal(size=(8, 3)) * 0.005
MAP = np.random.default_rng(3).normal(size=(8, 11)) * 0.2
BEND = np.random.default_rng(4).normal(size=(3, 11)) * 60.0


def inputs(count, seed=0):
    """Return standardised inputs (n, 8) about the simultaneous contact, and contacts (n, 3)."""
    u = np.random.default_rng(seed).normal(size=(count, 8))
    return u, u @ CONTACTS


def outcomes(u, instants, bend=0.0):
    """Return outcomes (n, 11) by `MAP`, per standard deviation, plus signed squares of times."""
    d = np.column_stack(
        [instants[:, i] - instants[:, j] for i, j in ((0, 1), (0, 2), (1, 2))]
    )
    scale = np.repeat([0.02, 0.1], [5, 6])
    return END + (u @ MAP + bend * (d * np.abs(d)) @ BEND * 10) * scale


def coefficients():
    """Return the derivative (8, 11) in SI units."""
    return MAP * np.repeat([0.02, 0.1], [5, 6]) / SPREAD[:, None]


def landings(count, seed=0, bend=0.0):
    """Return marker states (n, 18) at both sections, and contact instants (n, 3)."""
    u, instants = inputs(count, seed)
    x = np.hstack([np.zeros((count, 3)), MIDDLE + SPREAD * u])
    y = outcomes(u, instants, bend)
    return marker_states(x, ARMS), marker_states(y, ARMS), instants


def noisy(states, position, velocity, shared=0.0, seed=9):
    """Return states with normal noise in each coordinate, correlated by `shared`."""
    rng = np.random.default_rng(seed)
    a, b = (rng.normal(size=(len(states), states.shape[1] // 2)) for _ in range(2))
    noise = np.hstack(
        [position * a, velocity * (shared * a + np.sqrt(1 - shared**2) * b)]
    )
    return states + noise


def sklearn_errors(x, y, train, test):
    """Return errors (R, q) of scikit-learn's affine maps, fitted to each training set."""
    from sklearn.linear_model import LinearRegression

    # Its default tolerance drops directions that vary a million times less than others.
    return errors_by(LinearRegression(tol=1e-13), x, y, train, test)
