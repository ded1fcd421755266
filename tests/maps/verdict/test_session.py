"""Terms of a session are used where they foretell, and nowhere else."""

import numpy as np
import pytest

from hopdata.maps.verdict.session import LEAST_BLOCK, Session, session_terms


@pytest.fixture
def rng():
    return np.random.default_rng(8)


def _study(rng, change, n=400):
    """Return design, outcomes and states of landings; `change` (n,) bends the map."""
    states = rng.standard_normal((n, 3))
    design = np.column_stack([np.ones(n), states])
    outcomes = states @ rng.standard_normal((3, 2)) + change[:, None] * states[:, :2]
    outcomes += 0.1 * rng.standard_normal((n, 2))
    return design, outcomes, states


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_a_slow_change_is_fitted_and_nothing_else(rng, loss):
    time = np.arange(400.0)
    design, outcomes, states = _study(rng, loss * time / 400)
    session = Session.of(time, np.zeros(400, dtype=np.int64))
    found = session_terms(session, design, outcomes, states=states)
    assert found.used == (("time",) if loss else ())
    assert found.columns.shape == (400, 8 if loss else 0)


@pytest.mark.parametrize("softer", [0.0, 0.5])
def test_surfaces_by_turns_are_a_factor(rng, softer):
    surface = np.arange(400) % 2
    design, outcomes, states = _study(rng, softer * surface)
    session = Session.of(np.arange(400.0), surface)
    found = session_terms(session, design, outcomes, states=states)
    assert found.used == (("block",) if softer else ())


@pytest.mark.parametrize("softer", [0.0, 0.5])
def test_one_surface_after_the_other_is_a_change(rng, softer):
    """Nobody said which landings were on which surface."""
    time = np.arange(400.0)
    design, outcomes, states = _study(rng, softer * (time >= 143))
    session = Session.of(time, np.zeros(400, dtype=np.int64))
    found = session_terms(session, design, outcomes, states=states)
    assert found.used == (("change",) if softer else ())
    if softer:
        levels, counts = np.unique(found.columns[:, 0], return_counts=True)
        assert counts[levels < 0].sum() == pytest.approx(143, abs=1)


def test_too_few_landings_have_no_terms_of_the_session(rng):
    time = np.arange(25.0)
    design, outcomes, states = _study(rng, time / 25, n=25)
    session = Session.of(time, np.zeros(25, dtype=np.int64))
    assert session_terms(session, design, outcomes, states=states).used == ()


def test_a_block_of_few_landings_has_no_level():
    block = np.repeat([0, 1, 2], [60, 40, LEAST_BLOCK - 1])
    levels = Session.of(np.arange(len(block), dtype=float), block).levels()
    assert levels.shape == (len(block), 1)
    np.testing.assert_allclose(levels.mean(axis=0), 0.0, atol=1e-12)


def test_landings_at_one_instant_do_not_drift():
    session = Session.of(np.full(30, 7.0), np.zeros(30, dtype=np.int64))
    assert session.drift().shape == (30, 0)
    session = Session.of(np.array([3.0, 5.0, 4.0]), np.zeros(3, dtype=np.int64))
    np.testing.assert_array_equal(session.time, [-1.0, 1.0, 0.0])
