"""Callbacks: plain functions in Python, machine code called by address in the driver."""

from __future__ import annotations

import sys
import threading
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from hybrid_systems import (
    ball,
    fall_field,
    floor_guard,
    ladder_field,
    ladder_guards,
    raising_field,
    rebound,
)

from hopdata.hybrid import SlowCallbackWarning, System, field, guards, on_event, solve
from hopdata.hybrid import layout as codes
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.caught import Caught, current


def test_a_callback_is_still_a_python_function():
    slope = np.empty(2)
    ladder_field(
        0.0, np.array([3.0, 0.0]), np.array([1, -1]), np.array([0, 0, 2.0, 5.0]), slope
    )
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
    for _ in range(2):  # the second call uses the cache of the first
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

    assert solve(System(f, n_states=1), (0, 1), [0.0]).y_end[0] == pytest.approx(
        1.25, abs=1e-14
    )
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
        assert solve(make(speed), (0, 1), [0.0]).y_end[0] == pytest.approx(
            speed, abs=1e-14
        )


# Plain Python functions in the compiled driver: same results, same memory, same
# exceptions.

CONSTANTS = {"speed": 2.0}


def plain(callback: Callback) -> Callback:
    """Return the same function, uncompiled."""
    return Callback(callback.function, callback.signature, compiled=False)


def plain_ball():
    return System(
        plain(fall_field),
        plain(floor_guard),
        plain(rebound),
        n_states=2,
        guard_names=("floor",),
    )


@field(compiled=False)
def uniform(t, y, mode, params, dy):
    dy[:] = CONSTANTS["speed"]


def test_bit_for_bit_as_compiled():
    arguments = ((0, 3), [1.0, 0.0])
    one = solve(ball(), *arguments, params=(9.81, 0.0, 0.8))
    two = solve(plain_ball(), *arguments, params=(9.81, 0.0, 0.8))
    assert len(one.events) > 3
    assert not plain(fall_field).compiled
    for name in ("t", "y", "mode", "y_end", "nfev", "status"):
        assert np.array_equal(getattr(one, name), getattr(two, name)), name
    for name in ("time", "guard", "direction", "before", "after", "mode"):
        assert np.array_equal(getattr(one.events, name), getattr(two.events, name)), (
            name
        )


def test_compiled_and_plain_functions_may_stand_in_one_system():
    options = {"n_states": 2, "guard_names": ("a", "b")}
    arguments = ((0, 2), [0.0, 0.0])
    params = (0.5, 1.0, 1.0, 2.0)
    one = solve(
        System(ladder_field, ladder_guards, **options), *arguments, params=params
    )
    two = solve(
        System(ladder_field, plain(ladder_guards), **options), *arguments, params=params
    )
    assert np.array_equal(one.y, two.y)
    assert np.array_equal(one.events.time, two.events.time)


def test_what_numba_does_not_know_works_with_a_warning():
    @field
    def slow(t, y, mode, params, dy):
        dy[:] = CONSTANTS["speed"]

    with pytest.warns(SlowCallbackWarning, match=r"'slow' .*test_callbacks.py:\d+"):
        solution = solve(System(slow, n_states=3), (0, 1), [0.0, 1.0, 2.0])
    assert not slow.compiled
    assert solution.y_end == pytest.approx([2.0, 3.0, 4.0], abs=1e-13)


def test_scipy_closures_and_objects():
    from scipy.special import itj0y0, j0

    class Counter:
        calls = 0

    def make(counter):
        @field(compiled=False)
        def bessel(t, y, mode, params, dy):
            counter.calls += 1
            dy[0] = j0(params[0] * t)

        return bessel

    counter = Counter()
    solution = solve(
        System(make(counter), n_states=1), (0, 1), [0.0], params=(2.0,), rtol=1e-12
    )
    assert counter.calls == solution.nfev
    assert solution.y_end[0] == pytest.approx(itj0y0(2.0)[0] / 2, abs=1e-12)


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, ZeroDivisionError])
@pytest.mark.parametrize("where", ["field", "guards", "on_event"])
def test_exceptions_pass_unchanged(where, error):
    raised = error("at the edge")
    calls = []

    def failing(function):
        def call(*arguments):
            if arguments[0] > 0.3:
                calls.append(arguments[0])
                raise raised
            return function(*arguments)

        return call

    functions = {"field": fall_field, "guards": floor_guard, "on_event": rebound}
    signature = functions[where].signature
    functions[where] = Callback(
        failing(functions[where].function), signature, compiled=False
    )
    system = System(*functions.values(), n_states=2, guard_names=("floor",))
    with pytest.raises(error) as caught:
        solve(system, (0, 9), [1.0, 0.0], params=(9.81, 0.0, 0.8))
    assert caught.value is raised
    assert len(calls) == 1  # nothing is called after the exception


def test_an_integration_within_a_field():
    inner = System(uniform, n_states=1)

    @field(compiled=False)
    def outer(t, y, mode, params, dy):
        dy[0] = solve(inner, (0, 1), [t]).y_end[0]  # t + 2
        if t > params[0]:
            with pytest.raises(ValueError, match="beyond"):
                solve(
                    System(raising_field, n_states=2), (0, 2), [0.0, 0.0], params=(1.0,)
                )

    solution = solve(System(outer, n_states=1), (0, 1), [0.0], params=(0.9,))
    assert solution.y_end[0] == pytest.approx(2.5, abs=1e-12)


def test_threads_do_not_see_each_others_exceptions():
    compiled, results = System(raising_field, n_states=2), {}
    slow = System(plain(raising_field), n_states=2)

    def run(number):
        system, edge = (compiled, slow)[number % 2], (1.0, 99.0)[number // 2 % 2]
        try:
            end = solve(system, (0, 2), [0.0, 0.0], params=(edge,)).y_end[0]
        except ValueError as error:
            end = str(error)
        results.setdefault(number, []).append(end)

    def often(number):
        for _ in range(20):
            run(number)

    threads = [threading.Thread(target=often, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for number in (0, 1):
        assert set(results[number]) == {"beyond the edge of the map"}
    for number in (2, 3):
        assert results[number] == pytest.approx([2.0] * 20, abs=1e-13)


def test_nan_is_a_status_as_in_compiled_functions():
    @field(compiled=False)
    def root(t, y, mode, params, dy):
        dy[0] = np.nan if t > 0.5 else 1.0

    solution = solve(System(root, n_states=1), (0, 1), [0.0])
    assert solution.status == codes.FIELD_NOT_FINITE


def test_nan_from_the_start_is_not_taken_for_unfilled():
    @field(compiled=False)
    def nowhere(t, y, mode, params, dy):
        dy[0] = np.inf - np.inf

    solution = solve(System(nowhere, n_states=1), (0, 1), [0.0])
    assert solution.status == codes.FIELD_NOT_FINITE


def test_an_element_that_is_not_filled_is_named():
    @field(compiled=False)
    def half(t, y, mode, params, dy):
        dy[0] = 1.0

    with pytest.raises(ValueError, match=r"'half' .* does not fill dy\[1\]"):
        solve(System(half, n_states=2), (0, 1), [0.0, 0.0])


def test_guards_that_are_not_filled_are_named():
    @guards(compiled=False)
    def height(t, y, dy, mode, params, h, hdot):
        h[0] = y[0] + 0 * len(hdot)

    system = System(fall_field, height, n_states=2, guard_names=("floor",))
    with pytest.raises(ValueError, match=r"does not fill hdot\[0\]"):
        solve(system, (0, 1), [1.0, 0.0], params=(9.81,))


def test_a_result_that_should_not_be():
    @field(compiled=False)
    def returning(t, y, mode, params, dy):
        return y - dy

    with pytest.raises(TypeError, match="returns an array; fill dy in place"):
        solve(System(returning, n_states=2), (0, 1), [0.0, 0.0])


def test_a_handler_that_forgets_to_return():
    @on_event(compiled=False)
    def forgetful(t, y, mode, params, guard, direction):
        y[1] = -y[1]

    system = System(
        fall_field, floor_guard, forgetful, n_states=2, guard_names=("floor",)
    )
    with pytest.raises(TypeError, match="returns None; return 0 to go on, 1 to stop"):
        solve(system, (0, 2), [1.0, 0.0], params=(9.81, 0.0))


def test_callable_objects():
    class Fall:
        def __call__(self, t, y, mode, params, dy):  # noqa: ARG002
            dy[0], dy[1] = y[1], -params[0]

    with pytest.warns(SlowCallbackWarning, match="Fall object"):
        solution = solve(
            System(field(Fall()), n_states=2), (0, 1), [1.0, 0.0], params=(2.0,)
        )
    assert solution.y_end == pytest.approx([0.0, -2.0], abs=1e-13)


@pytest.mark.parametrize("compiled", [True, False])
def test_the_function_from_other_compiled_code(compiled):
    one = Callback(fall_field.function, fall_field.signature, compiled)
    dy = np.zeros(2)
    one.dispatcher(
        0.0, np.array([1.0, 3.0]), np.zeros(1, np.int64), np.array([9.81]), dy
    )
    assert dy.tolist() == [3.0, -9.81]


# Exceptions reach the thread that catches them; those of other threads reach the
# previous hook.


@pytest.fixture
def passed_on(monkeypatch):
    seen: list = []
    monkeypatch.setattr(sys, "unraisablehook", seen.append)
    return seen


def unraisable(error, source="Numba's context"):
    return SimpleNamespace(exc_value=error, object=source)


def test_keeps_what_machine_code_raises(passed_on):
    error = ValueError()
    with Caught() as caught:
        sys.unraisablehook(unraisable(error))
    assert caught == [error]
    assert passed_on == []


def test_the_rest_goes_to_the_hook_that_was_there(passed_on):
    outside, destructor = unraisable(ValueError()), unraisable(ValueError(), object())
    with Caught() as caught:
        sys.unraisablehook(destructor)
    sys.unraisablehook(outside)
    assert caught == []
    assert passed_on == [destructor, outside]


def test_blocks_within_blocks(passed_on):
    with Caught() as outer:
        with Caught() as inner:
            sys.unraisablehook(unraisable(KeyError()))
            assert current() is inner
        assert current() is outer
    assert current() is None
    assert (len(outer), len(inner)) == (0, 1)


def test_each_thread_has_its_own(passed_on):
    with Caught() as caught:
        thread = threading.Thread(
            target=lambda: sys.unraisablehook(unraisable(KeyError()))
        )
        thread.start()
        thread.join()
    assert caught == []
    assert len(passed_on) == 1


def test_a_hook_that_calls_the_one_before_it(monkeypatch):
    with Caught():
        ours = sys.unraisablehook
    ended = []
    monkeypatch.setattr(sys, "__unraisablehook__", ended.append)
    monkeypatch.setattr(sys, "unraisablehook", lambda one: ours(one))  # noqa: PLW0108
    with Caught():
        sys.unraisablehook(unraisable(KeyError(), object()))
    assert len(ended) == 1


def _falls_by(pull, t, y):
    return y[1], -pull


def test_a_partial_is_told_what_to_write():
    with pytest.warns(
        SlowCallbackWarning, match="functools.partial of '_falls_by'"
    ) as told:
        found = solve(
            System(partial(_falls_by, 2.0), n_states=2), (0.0, 1.0), [0.0, 0.0]
        )
    np.testing.assert_allclose(found.y_end, [-1.0, -2.0])
    text = str(told[0].message)
    assert "as params" in text
    assert "that calls '_falls_by'" in text
