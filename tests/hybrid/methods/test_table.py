"""The choice of a method by its name."""

from __future__ import annotations

import os
from time import process_time

import numpy as np
import pytest
from hybrid_systems import ladder

from hopdata.hybrid import System, field, guards, on_event, solve, solve_batch
from hopdata.hybrid.driver.loop import compiled_first_order
from hopdata.hybrid.methods import table
from hopdata.hybrid.methods.table import choices, generic_code

OPTIONS = {"params": (0.5, 1.0)}


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("dop835", "dop853"), ("dopri", "dopri5"), ("Dopri5", "dopri5"), ("tailor", "taylor"),
        ("rosenbrok", "rosenbrock"), ("atuo", "auto"),
    ],
)  # fmt: skip
def test_a_name_that_is_nearly_right(name, near):
    for call in (solve, solve_batch):
        start = [0.0, 0.0] if call is solve else [[0.0, 0.0]]
        with pytest.raises(
            ValueError, match=rf"found '{name}'; did you mean '{near}'\?$"
        ):
            call(ladder(1), (0, 1), start, method=name, **OPTIONS)


@pytest.mark.parametrize("name", ["Radau!", "", None, 5])
def test_a_name_like_no_other(name):
    with pytest.raises(ValueError, match=r"method: expected one of auto, ") as caught:
        solve(ladder(1), (0, 1), [0.0, 0.0], method=name, **OPTIONS)
    assert "did you mean" not in str(caught.value)
    assert all(choice in str(caught.value) for choice in choices())


def test_taylor_needs_an_affine_form():
    with pytest.raises(
        ValueError, match="an @affine function for 'taylor', found none"
    ):
        solve(ladder(1), (0, 1), [0.0, 0.0], method="taylor", **OPTIONS)


def test_an_error_leaves_the_system_usable():
    system = ladder(1)
    with pytest.raises(ValueError, match="method"):
        solve(system, (0, 1), [0.0, 0.0], method="taylor", **OPTIONS)
    assert solve(system, (0, 1), [0.0, 0.0], **OPTIONS).y_end[0] == pytest.approx(1.5)


# Generic code and a scene's own code give the same bytes; the time spent decides which
# runs.


@pytest.fixture(autouse=True)
def empty_cache(tmp_path, monkeypatch):
    """Make scenes new to the cache, leave nothing in it, and let them stay generic."""
    monkeypatch.setattr(table, "WORTH_COMPILING", np.inf)
    for name in table.TABLEAUS:
        generic_code(name)
    solve(ring(1), (0.0, 0.1), [1.0])  # the driver comes from the cache of the install
    compiled_first_order()  # and the code that carries Jacobians through events
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))


def swing(t, y, mode, params, dy):
    n = len(y)
    for i in range(n):
        dy[i] = (
            np.sin(3.0 * y[(i + 1) % n]) - 0.3 * y[i] ** 3 + mode[1] * np.cos(5.0 * t)
        )


def switch(t, y, dy, mode, params, h, hdot):
    h[0] = np.sin(4.0 * t) + 0.1 * y[0] - 0.05
    hdot[0] = 4.0 * np.cos(4.0 * t) + 0.1 * dy[0]


def flip(t, y, mode, params, guard, direction):
    mode[1] = 1 - mode[1]
    y[len(y) - 1] += 1e-3
    return 0


PARTS = {
    compiled: tuple(
        declare(one, compiled=compiled)
        for declare, one in ((field, swing), (guards, switch), (on_event, flip))
    )
    for compiled in (True, False)
}


def ring(n, compiled=True):
    """Return coupled oscillators in a ring, with a drive that the handler switches on and off.

    All sizes share their functions, which are compiled once.
    """
    return System(
        *PARTS[compiled], n_states=n, guard_names=("switch",), n_extra_modes=1
    )


def outcome(system, method, **options):
    y0 = np.linspace(0.3, 1.0, system.n_states)
    s = solve(system, (0.0, 6.0), y0, mode=[1], method=method, **options)
    assert s.status == 0
    return s


def tiers(system, method):
    """Return the numbers of the methods that are currently generic."""
    return system.methods(method, False).generic


#: With and without a partial last vector; each compiles for a second.
SIZES = {"dopri5": (3, 12), "dop853": (3, 8)}
if "ALL" in os.environ:
    SIZES = {"dopri5": (1, 3, 4, 12), "dop853": (3, 5, 8)}


@pytest.mark.parametrize(
    ("method", "n"), [(name, n) for name in table.TABLEAUS for n in SIZES[name]]
)
def test_same_bytes(monkeypatch, method, n):
    system = ring(n)
    generic = outcome(system, method)
    assert tiers(system, method)
    monkeypatch.setattr(table, "WORTH_COMPILING", 0.0)
    own = outcome(system, method)
    assert not tiers(system, method)
    assert len(generic.events) > 5
    assert generic.t.tobytes() == own.t.tobytes()
    assert generic.y.tobytes() == own.y.tobytes()
    assert generic.events.time.tobytes() == own.events.time.tobytes()
    assert generic.nfev == own.nfev


def test_same_bytes_with_tolerances_of_zero_and_dense_output(monkeypatch):
    system = ring(3)
    options = {"atol": 0.0, "rtol": 1e-5, "t_eval": np.linspace(0.0, 6.0, 77)}
    generic = outcome(system, "auto", **options)
    monkeypatch.setattr(table, "WORTH_COMPILING", 0.0)
    assert outcome(system, "auto", **options).y.tobytes() == generic.y.tobytes()
    assert not tiers(system, "auto")


def test_a_field_in_python_never_has_code_of_its_own(monkeypatch):
    plain = ring(2, compiled=False)
    compiled = ring(2)
    monkeypatch.setattr(table, "WORTH_COMPILING", 0.0)
    first = outcome(plain, "dopri5")
    second = outcome(plain, "dopri5")
    assert tiers(plain, "dopri5") == {0}
    other = outcome(compiled, "dopri5")
    assert first.y.tobytes() == second.y.tobytes()
    assert np.abs(first.y_end - other.y_end).max() < 1e-8


def test_changes_within_an_integration(monkeypatch):
    """The driver returns for more room, and continues with the scene's own code."""
    system = ring(2)
    whole = outcome(ring(2), "dopri5", max_step=0.01)
    monkeypatch.setattr(table, "WORTH_COMPILING", 1e-7)
    changed = outcome(system, "dopri5", max_step=0.01)
    assert not tiers(system, "dopri5")
    assert changed.y.tobytes() == whole.y.tobytes()


def test_counts_the_time_of_all_integrations(monkeypatch):
    system = ring(2)
    outcome(system, "dopri5")
    methods = system.methods("dopri5", False)
    first = methods.seconds
    outcome(system, "dopri5")
    both = methods.seconds
    assert 0.0 < first < both
    assert tiers(system, "dopri5") == {0}
    monkeypatch.setattr(table, "WORTH_COMPILING", both)
    outcome(system, "dopri5")
    assert not tiers(system, "dopri5")
    assert methods.seconds == both  # counted only while it is generic


def test_the_time_to_compile_does_not_count():
    system = ring(2)
    start = process_time()
    outcome(system, "dopri5")
    whole = process_time() - start  # with the machine code of field and guards
    assert system.methods("dopri5", False).seconds < 0.2 * whole


def test_a_new_process_begins_with_what_is_in_the_cache(monkeypatch):
    system = scene_of_this_file()
    outcome(system, "dopri5")
    system.methods("dopri5", False).compile(0)
    again = scene_of_this_file()
    outcome(again, "dopri5")
    assert not tiers(again, "dopri5")


@field
def decay(t, y, mode, params, dy):
    dy[0] = -y[0]


def scene_of_this_file():
    return System(decay, n_states=1, n_extra_modes=1)


def test_a_large_batch_is_worth_compiling_a_small_one_is_not(monkeypatch):
    system = ring(2)
    y0 = np.array([[0.3, 1.0 + 0.01 * k] for k in range(70)])
    small = solve_batch(system, (0.0, 6.0), y0, mode=[1], method="dopri5")
    assert tiers(system, "dopri5") == {0}
    spent = system.methods("dopri5", False).seconds
    monkeypatch.setattr(table, "WORTH_COMPILING", 1.5 * spent)
    large = solve_batch(
        system, (0.0, 6.0), np.tile(y0, (2, 1)), mode=[1], method="dopri5"
    )
    assert not tiers(system, "dopri5")
    assert large.y_end[:70].tobytes() == small.y_end.tobytes()


def test_an_empty_batch():
    assert len(solve_batch(ring(2), (0.0, 1.0), np.empty((0, 2)), mode=[1])) == 0


@pytest.mark.parametrize("limit", [0.0, np.inf])
def test_what_the_field_raises_reaches_the_caller(monkeypatch, limit):
    @field
    def breaks(t, y, mode, params, dy):
        if y[0] > 0.5:
            raise ZeroDivisionError("too late")
        dy[0] = 1.0
        dy[1] = y[0]

    system = System(breaks, n_states=2)
    monkeypatch.setattr(table, "WORTH_COMPILING", limit)
    with pytest.raises(ZeroDivisionError, match="too late"):
        solve(system, (0.0, 1.0), [0.0, 0.0], method="dopri5")
    assert len(tiers(system, "dopri5")) == (limit > 0.0)


@pytest.mark.parametrize("name", table.TABLEAUS)
def test_jacobians_have_the_same_bytes_by_either_code(name, monkeypatch):
    system = ring(3)
    generic = outcome(system, name, jacobian=True)
    assert system.methods(name, True).generic  # nothing is compiled for a new scene
    monkeypatch.setattr(table, "WORTH_COMPILING", 0.0)
    own = outcome(system, name, jacobian=True)
    assert not system.methods(name, True).generic
    assert generic.jacobian.tobytes() == own.jacobian.tobytes()


def test_compiled_beforehand(monkeypatch):
    system = ring(3)
    generic = outcome(ring(3), "auto")
    system.compile()
    monkeypatch.setattr(
        table.MethodTable, "compile", None
    )  # nothing remains to be compiled
    assert outcome(system, "auto").y.tobytes() == generic.y.tobytes()
    assert solve_batch(
        system, (0.0, 6.0), np.ones((3, 3)), mode=[1], method="auto"
    ).success
    assert not tiers(system, "auto")


def test_compiled_in_place_of_generic_code(monkeypatch):
    system = ring(2)
    generic = outcome(system, "dopri5")
    assert tiers(system, "dopri5") == {0}
    system.compile("dopri5")
    assert not tiers(system, "dopri5")
    monkeypatch.setattr(table.MethodTable, "compile", None)
    assert outcome(system, "dopri5").y.tobytes() == generic.y.tobytes()


def test_a_field_in_python_can_be_asked_for_beforehand():
    system = ring(2, compiled=False)
    system.compile("dopri5")
    assert tiers(system, "dopri5") == {0}
    assert outcome(system, "dopri5").success


def test_compiles_with_the_jacobian():
    system = System(decay, n_states=1)
    system.compile("dopri5", jacobian=True)
    s = solve(system, (0.0, 1.0), [1.0], method="dopri5", jacobian=True)
    np.testing.assert_allclose(s.jacobian, np.exp(-1.0), rtol=1e-8)


def test_compile_names_the_method_that_it_does_not_know():
    with pytest.raises(ValueError, match="did you mean 'dopri5'"):
        ring(1).compile("dopri")
    with pytest.raises(ValueError, match="jacobian: expected True or False"):
        ring(1).compile("dopri5", jacobian="yes")
