"""Callbacks: plain functions in Python, machine code by address in the driver."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ladder_field, ladder_guards, rebound

from hopdata.hybrid import System, field, solve


def test_a_callback_is_still_a_python_function():
    slope = np.empty(2)
    ladder_field(0.0, np.array([3.0, 0.0]), np.array([1, -1]), np.array([0, 0, 2.0, 5.0]), slope)
    assert slope.tolist() == [3.0, 3.0]
    assert ladder_guards.__name__ == "ladder_guards"
    assert "rebound" in repr(rebound)


def test_the_address_is_compiled_once():
    assert ladder_field.address == ladder_field.address > 0


def test_functions_typed_at_a_prompt_work():
    names = {"field": field}
    exec("@field\ndef f(t, y, mode, params, dy):\n    dy[0] = 2.0\n", names)
    solution = solve(System(names["f"], n_states=1), (0, 1), [1.0])
    assert solution.y_end[0] == pytest.approx(3.0, abs=1e-14)


@pytest.mark.parametrize("name", [None, "<a module that nobody can import>"])
def test_functions_that_cannot_be_cached_are_compiled_all_the_same(tmp_path, name):
    source = "def f(t, y, mode, params, dy):\n    dy[0] = FACTOR * abs(y[0])\n"
    (tmp_path / "f.py").write_text(source)
    scope = {"FACTOR": 2.0} if name is None else {"FACTOR": 2.0, "__name__": name}
    exec(compile(source, str(tmp_path / "f.py"), "exec"), scope)
    for _ in range(2):  # the second looks into the cache of the first
        callback = field(scope["f"])
        assert solve(System(callback, n_states=1), (0, 0.1), [0.0]).success
        assert callback.compiled


def test_a_full_disk_does_not_matter(monkeypatch):
    def full(*_):
        raise OSError("No space left on device")

    monkeypatch.setattr("numba.core.caching.IndexDataCacheFile.save", full)

    @field
    def f(t, y, mode, params, dy):
        dy[0] = 1.25

    assert solve(System(f, n_states=1), (0, 1), [0.0]).y_end[0] == pytest.approx(1.25, abs=1e-14)
    assert f.compiled


def test_division_by_zero_is_not_an_exception_but_infinity():
    @field
    def pole(t, y, mode, params, dy):
        dy[0] = 1.0 / (t - params[0])

    solution = solve(System(pole, n_states=1), (0.5, 1), [1.0], params=(0.5,))
    assert solution.status < 0
    assert solution.t_end == 0.5


def test_closures_are_compiled_with_their_constants():
    def make(speed):
        @field
        def moving(t, y, mode, params, dy):
            dy[0] = speed

        return System(moving, n_states=1)

    for speed in (2.0, 5.0):
        assert solve(make(speed), (0, 1), [0.0]).y_end[0] == pytest.approx(speed, abs=1e-14)
