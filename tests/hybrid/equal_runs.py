"""Two runs that should be the same: there and back, awake and asleep, alone and in a batch."""

from __future__ import annotations

import numpy as np

from hopdata.hybrid import solve


def there_and_back(system, t_span, y0, **options):
    """Integrate to the end and back; return both solutions and the distance from the start."""
    there = solve(system, t_span, y0, **options)
    mode = np.concatenate([np.zeros(system.n_guards), there.mode[system.n_guards :]])
    back = solve(system, t_span[::-1], there.y_end, **{**options, "mode": mode})
    assert there.status == 0, there
    assert back.status == 0, back
    assert back.t_end == t_span[0]
    return there, back, np.abs(back.y_end - y0)


def same_instants(there, back):
    """Check that both crossed the same guards from opposite sides; return the time differences."""
    one, other = there.events, back.events
    assert one.guard.tolist() == other.guard[::-1].tolist()
    assert one.direction.tolist() == (-other.direction[::-1]).tolist()
    return np.abs(one.time - other.time[::-1]).max()


def assert_same_events(plain, sparse, tolerance=1e-9):
    """Check that a system whose guards sleep meets what it meets awake."""
    assert sparse.status == plain.status == 0
    assert sparse.events.guard.tolist() == plain.events.guard.tolist()
    assert sparse.events.direction.tolist() == plain.events.direction.tolist()
    assert sparse.mode.tolist() == plain.mode.tolist()
    assert np.abs(sparse.events.time - plain.events.time).max() < tolerance
    assert np.abs(sparse.y_end - plain.y_end).max() < tolerance


def same_bytes(one, other):
    """Tell whether two solutions have the same bytes."""
    return (
        one.t.tobytes() == other.t.tobytes()
        and one.y.tobytes() == other.y.tobytes()
        and one.events.time.tobytes() == other.events.time.tobytes()
        and one.events.mode.tobytes() == other.events.mode.tobytes()
        and one.message == other.message
    )


def assert_same_row(batch, place, single):
    """Assert that the row of a batch has the bytes of a single solution."""
    assert batch.status[place] == single.status
    assert batch.t_end[place] == single.t_end
    assert batch.y_end[place].tobytes() == single.y_end.tobytes()
    assert batch.mode[place].tolist() == single.mode.tolist()
    counts = (batch.n_events[place], batch.n_steps[place], batch.nfev[place])
    assert counts == (len(single.events), single.n_steps, single.nfev)
    if batch.jacobian is not None:
        assert batch.jacobian[place].tobytes() == single.jacobian.tobytes()
    if batch.y is not None:
        reached = single.y.shape[1]
        assert np.array_equal(batch.y[place, :, :reached], single.y)
        assert np.isnan(batch.y[place, :, reached:]).all()
