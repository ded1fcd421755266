"""Plain Python functions in the compiled driver: same results, same memory, same exceptions."""

from __future__ import annotations

import threading

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
from hopdata.hybrid import status as codes
from hopdata.hybrid.compiled.callbacks import Callback

CONSTANTS = {"speed": 2.0}


def plain(callback: Callback) -> Callback:
    """The same function, not compiled."""
    return Callback(callback.function, callback.signature, compiled=False)


def plain_ball():
    return System(
        plain(fall_field), plain(floor_guard), plain(rebound), n_states=2, guard_names=("floor",)
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
        assert np.array_equal(getattr(one.events, name), getattr(two.events, name)), name


def test_compiled_and_plain_functions_may_stand_in_one_system():
    options = {"n_states": 2, "guard_names": ("a", "b")}
    arguments = ((0, 2), [0.0, 0.0])
    params = (0.5, 1.0, 1.0, 2.0)
    one = solve(System(ladder_field, ladder_guards, **options), *arguments, params=params)
    two = solve(System(ladder_field, plain(ladder_guards), **options), *arguments, params=params)
    assert np.array_equal(one.y, two.y)
    assert np.array_equal(one.events.time, two.events.time)


def test_what_numba_does_not_know_works_with_a_warning():
    @field
    def slow(t, y, mode, params, dy):
        dy[:] = CONSTANTS["speed"]

    with pytest.warns(SlowCallbackWarning, match=r"'slow' .*test_trampoline.py:\d+"):
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
    solution = solve(System(make(counter), n_states=1), (0, 1), [0.0], params=(2.0,), rtol=1e-12)
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
    functions[where] = Callback(failing(functions[where].function), signature, compiled=False)
    system = System(*functions.values(), n_states=2, guard_names=("floor",))
    with pytest.raises(error) as caught:
        solve(system, (0, 9), [1.0, 0.0], params=(9.81, 0.0, 0.8))
    assert caught.value is raised
    assert len(calls) == 1  # nothing is called after it


def test_an_integration_within_a_field():
    inner = System(uniform, n_states=1)

    @field(compiled=False)
    def outer(t, y, mode, params, dy):
        dy[0] = solve(inner, (0, 1), [t]).y_end[0]  # t + 2
        if t > params[0]:
            with pytest.raises(ValueError, match="beyond"):
                solve(System(raising_field, n_states=2), (0, 2), [0.0, 0.0], params=(1.0,))

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

    system = System(fall_field, floor_guard, forgetful, n_states=2, guard_names=("floor",))
    with pytest.raises(TypeError, match="returns None; return 0 to go on, 1 to stop"):
        solve(system, (0, 2), [1.0, 0.0], params=(9.81, 0.0))


def test_callable_objects():
    class Fall:
        def __call__(self, t, y, mode, params, dy):  # noqa: ARG002
            dy[0], dy[1] = y[1], -params[0]

    with pytest.warns(SlowCallbackWarning, match="Fall object"):
        solution = solve(System(field(Fall()), n_states=2), (0, 1), [1.0, 0.0], params=(2.0,))
    assert solution.y_end == pytest.approx([0.0, -2.0], abs=1e-13)


@pytest.mark.parametrize("compiled", [True, False])
def test_the_function_from_other_compiled_code(compiled):
    one = Callback(fall_field.function, fall_field.signature, compiled)
    dy = np.zeros(2)
    one.dispatcher(0.0, np.array([1.0, 3.0]), np.zeros(1, np.int64), np.array([9.81]), dy)
    assert dy.tolist() == [3.0, -9.81]
