# ruff: noqa: ARG005, RET504, RUF059 (functions as people write them)
"""Functions as people write them: each form gives what the integrator's own form does."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from numpy import array, zeros

from hopdata.hybrid import System, field, guards, jacobian, on_event, solve, solve_batch
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.kernel import SIGNATURES
from hopdata.hybrid.layout import FIELD_NOT_FINITE
from hopdata.hybrid.numbers.guards import guards_for_ranges

GRAVITY = 9.81
PARAMS = (9.81, 0.8)


@field
def own_fall(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -params[0]


@guards
def own_floor(t, y, dy, mode, params, h, hdot):
    h[0] = -y[0]
    hdot[0] = -dy[0]


@on_event
def own_bounce(t, y, mode, params, guard, direction):
    if direction > 0:
        y[1] *= -params[1]
    return 0


def ball(fall=own_fall, floor=own_floor, bounce=own_bounce, **options):
    options = {"n_states": 2, "guard_names": ("floor",)} | options
    return System(fall, floor, bounce, **options)


def as_tuple(t, y, p):
    return y[1], -p[0]


def as_list(t, y, p):
    return [y[1], -p[0]]


def as_array(t, y, p):
    return np.array([y[1], -p[0]])


def as_imported_array(t, y, p):
    return array((y[1], -p[0]), dtype=float)


def with_a_list_of_its_own(t, y, p):
    dydt = [y[1], -p[0]]
    return dydt


def with_an_array_of_its_own(t, y, p):
    dydt = np.zeros(2)
    dydt[0] = y[1]
    dydt[1] -= p[0]
    return dydt


def with_zeros_like(t, y, p):
    dydt = np.zeros_like(y)
    dydt[0], dydt[1] = y[1], -p[0]
    return dydt


def with_an_array_that_changes(t, y, p):
    rate = np.array([y[1], 0.0])
    rate[1] = -p[0]
    return rate


def unpacked(t, y, p):
    height, velocity = y
    return velocity, -p[0]


def joined(t, y, p):
    return np.concatenate((y[1:], np.array([-p[0]])))


def on_two_paths(t, y, p):
    if y[1] > 1e9:
        return [0.0, 0.0]
    rates = y[1], -p[0]
    return rates


def with_mode(t, y, mode, p):
    return y[1], -p[0] + 0.0 * mode[0]


def fills(t, y, p, dy):
    dy[0] = y[1]
    dy[1] = -p[0]


def named_otherwise(time, state, gravity_and_loss):
    return [state[1], -gravity_and_loss[0]]


def with_a_default(t, y, p, factor=1.0):
    return y[1], -factor * p[0]


def helper(p):
    return -p[0]


def with_a_helper(t, y, p):
    return y[1], helper(p)


def with_a_global(t, y):
    return y[1], -GRAVITY


FIELDS = [
    as_tuple,
    as_list,
    as_array,
    as_imported_array,
    with_a_list_of_its_own,
    with_an_array_of_its_own,
    with_zeros_like,
    with_an_array_that_changes,
    unpacked,
    joined,
    on_two_paths,
    with_mode,
    fills,
    named_otherwise,
    with_a_default,
    with_a_helper,
    with_a_global,
    lambda t, y, p: (y[1], -p[0]),
]
NAMES = [one.__name__ for one in FIELDS]


def call(callback, *arguments):
    """Return what the compiled function fills."""
    result = np.full(2, np.nan)
    callback.dispatcher(*arguments, result)
    return result


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("function", FIELDS, ids=NAMES)
def test_a_field_gives_what_the_own_form_gives(function):
    state = np.array([2.0, 3.0])
    mode = np.array([-1])
    callback = field(function)
    expected = [3.0, -9.81]
    assert call(callback, 0.0, state, mode, np.array(PARAMS)).tolist() == expected
    assert callback.compiled
    in_python = np.empty(2)
    callback.function(0.0, state, mode, np.array(PARAMS), in_python)
    assert in_python.tolist() == expected


def test_lists_and_arrays_that_are_returned_are_never_made():
    """The written code has no call besides the store, which takes a tuple."""
    for function in (as_list, as_array, with_a_list_of_its_own):
        written = field(function)._written.function
        assert "array" not in written.__code__.co_names
        assert field(function).count == 2
    assert (
        "zeros"
        not in field(with_an_array_of_its_own)._written.function.__code__.co_names
    )
    # What is not understood is left as it is.
    assert "concatenate" in field(joined)._written.function.__code__.co_names
    assert field(joined).count is None


def test_undecorated_functions_of_a_system():
    def floor(t, y):
        return -y[0]

    def bounce(t, y, p, direction):
        if direction > 0:
            return y[0], -p[1] * y[1]
        return None

    own = solve(ball(), (0, 2), [1.0, 0.0], params=PARAMS)
    plain = ball(as_list, floor, bounce)
    found = solve(plain, (0, 2), [1.0, 0.0], params=PARAMS)
    assert all(one.compiled for one in plain.callbacks)
    assert len(own.events) == 6
    assert found.events.time == pytest.approx(own.events.time, rel=1e-12)
    assert found.y_end == pytest.approx(own.y_end, rel=1e-10)
    checked = solve(plain, (0, 2), [1.0, 0.0], params=PARAMS, debug=True)
    assert checked.y_end == pytest.approx(own.y_end, rel=1e-10)


def handler_in_place(t, y, p, direction):
    if direction > 0:
        y[1] *= -p[1]


def handler_with_a_view(t, y, p, direction):
    if direction > 0:
        y[1] *= -p[1]
    return y[::1]


def handler_of_guard(t, y, mode, p, guard, direction):
    return 0


def handler_that_stops(t, y, direction):
    return direction < 0


def handler_without_p(t, y):
    y[1] = abs(y[1]) * 0.8


@pytest.mark.parametrize("handler", [handler_in_place, handler_with_a_view])
def test_handlers_that_change_the_state(handler):
    own = solve(ball(), (0, 2), [1.0, 0.0], params=PARAMS)
    found = solve(ball(bounce=handler), (0, 2), [1.0, 0.0], params=PARAMS)
    assert found.y_end.tolist() == own.y_end.tolist()


def bounce_whatever_the_direction(t, y, p):
    return y[0], -p[1] * y[1]


def test_a_handler_that_acts_at_rises_and_falls_alike_is_told_what_to_do():
    """It turns back what it has just turned, unless one direction alone is an event."""
    for_ever = ball(bounce=bounce_whatever_the_direction)
    found = solve(for_ever, (0, 2), [1.0, 0.0], params=PARAMS)
    assert not found.success
    assert "directions=" in found.message
    once = ball(bounce=bounce_whatever_the_direction, directions=(1,))
    found = solve(once, (0, 2), [1.0, 0.0], params=PARAMS)
    own = solve(ball(), (0, 2), [1.0, 0.0], params=PARAMS)
    assert found.success
    assert found.y_end == pytest.approx(own.y_end, rel=1e-12)


def test_a_handler_stops_by_true():
    found = solve(
        ball(bounce=handler_that_stops, directions=(0,)),
        (0, 2),
        [-1.0, 10.0],
        params=PARAMS,
    )
    assert found.status == 1
    assert found.n_events == 1
    assert found.y_end[0] == pytest.approx(0.0, abs=1e-9)


def test_one_state_and_one_number():
    def decay(t, y):
        return -y[0]

    def low(t, y):
        return y[0] - 0.5

    def refill(t, y):
        return 1.0

    system = System(decay, low, refill, guard_names=("low",), directions=(-1,))
    found = solve(system, (0, 3), [1.0])
    half_lives = math.log(2.0) * np.arange(1, 5)
    assert found.events.time == pytest.approx(half_lives, rel=1e-9)
    assert found.events.after.ravel().tolist() == [1.0] * 4


def test_a_returned_jacobian():
    matrix = np.empty((2, 2))

    @jacobian
    def stiff(t, y, p):
        return [[0, 1], [-p[0], 2 * y[0]]]

    stiff.dispatcher(
        0.0, np.array([3.0, 0.0]), np.zeros(1, int), np.array([5.0]), matrix
    )
    assert stiff.compiled
    assert matrix.tolist() == [[0.0, 1.0], [-5.0, 6.0]]


def test_functions_typed_at_a_prompt():
    names = {}
    exec("def f(t, y, p):\n    return [p[0], 2.0]\n", names)
    callback = field(names["f"])
    found = solve(System(callback, n_states=2), (0, 1), [0.0, 0.0], params=[3.0])
    assert callback.compiled
    assert found.y_end == pytest.approx([3.0, 2.0], rel=1e-12)


HANDLERS = [
    "return y[0], -p[1] * y[1]",
    "return np.array([y[0], -p[1] * y[1]])",
    "return [y[0], -p[1] * y[1]]",
]


@pytest.mark.parametrize("result", HANDLERS)
def test_handlers_whose_source_is_not_known(result):
    names = {"np": np}
    lines = [
        "def bounce(t, y, p, direction):",
        "    if direction > 0:",
        f"        {result}",
    ]
    exec("\n".join(lines), names)
    system = ball(bounce=names["bounce"])
    own = solve(ball(), (0, 2), [1.0, 0.0], params=PARAMS)
    for _ in range(100):  # an array that is freed twice would end the process
        found = solve(system, (0, 2), [1.0, 0.0], params=PARAMS)
    assert system.on_event.compiled
    assert found.y_end.tolist() == own.y_end.tolist()


def test_parameters_as_states_and_backward():
    """In derived systems, what unpacks the state gets the user's states only."""
    system = ball(unpacked, lambda t, y: -y[0], handler_in_place, undo=handler_back)
    own = solve(ball(), (0, 1), [1.0, 0.0], params=PARAMS, jacobian="params")
    found = solve(system, (0, 1), [1.0, 0.0], params=PARAMS, jacobian="params")
    assert found.sensitivity == pytest.approx(own.sensitivity, rel=1e-6)
    back = solve(system, (1, 0), found.y_end, params=PARAMS, mode=found.mode)
    assert back.y_end == pytest.approx([1.0, 0.0], abs=1e-7)


def handler_back(t, y, p, direction):
    if direction > 0:
        y[1] /= -p[1]


def test_rates_of_guards_are_exact():
    def wavy(t, y):
        return -y[0] + 0.01 * np.sin(50.0 * t)

    guards = ball(floor=wavy).guards
    h, hdot = np.empty(1), np.empty(1)
    given = np.array([1.0, 2.0]), np.array([2.0, -9.81]), np.zeros(1, int), np.empty(0)
    guards.dispatcher(0.3, *given, h, hdot)
    assert hdot[0] == pytest.approx(-2.0 + 0.5 * np.cos(15.0), rel=1e-15)
    # Python takes a difference.
    guards.function(0.3, *given, h, hdot)
    assert hdot[0] == pytest.approx(-2.0 + 0.5 * np.cos(15.0), rel=1e-6)


def listed(t, y, p):
    return [max(y[0], p[0]), abs(y[1])]


def unpacked_guards(t, y):
    height, velocity = y
    return height - velocity, np.sin(t)


def made_and_filled(t, y):
    h = np.zeros(2)
    h[0] = y[0] * y[1]
    h[1] += t
    return h


def with_a_branch(t, y):
    if y[0] > 0.0:
        return np.array([y[1] % 1.0, t])
    return -1.0, slope_of(t)


@pytest.mark.parametrize(
    "function", [listed, unpacked_guards, made_and_filled, with_a_branch]
)
def test_plain_guards_compile_for_ranges(function):
    global SLOPE
    SLOPE = 1.0
    found = guards_for_ranges(Callback(function, SIGNATURES["guards"]))
    assert found.reason == ""
    assert found.address > 0


def test_a_file_that_has_changed_since(tmp_path):
    """The function runs as it was read, not as the file is now."""
    path = tmp_path / "changed.py"
    path.write_text("def f(t, y):\n    return [1.0]\n")
    names = {"__name__": "changed"}
    exec(compile(path.read_text(), str(path), "exec"), names)
    path.write_text("def f(t, y):\n    return [2.0]\n")
    assert solve(System(names["f"]), (0, 1), [0.0]).y_end[0] == pytest.approx(1.0)


def test_globals_and_closures_that_change():
    rates = {"fast": 1.0}

    def make():
        speed = 1.0

        def moving(t, y):
            return [speed * FACTOR]

        def hurry(new):
            nonlocal speed
            speed = new

        return moving, hurry

    global FACTOR
    FACTOR = 1.0
    moving, hurry = make()
    system = System(moving)
    found = [solve(system, (0, 1), [0.0]).y_end[0]]
    FACTOR = 3.0
    found.append(solve(system, (0, 1), [0.0]).y_end[0])
    hurry(2.0)
    found.append(solve(system, (0, 1), [0.0]).y_end[0])
    assert found == pytest.approx([1.0, 3.0, 6.0], rel=1e-12)
    assert rates


def test_a_global_of_a_helper_changes():
    global SLOPE
    SLOPE = 1.0
    system = System(with_slope)
    first = solve(system, (0, 1), [0.0]).y_end[0]
    SLOPE = 4.0
    second = solve(system, (0, 1), [0.0]).y_end[0]
    assert (first, second) == pytest.approx((1.0, 4.0), rel=1e-12)


def slope_of(y):
    return SLOPE


def with_slope(t, y):
    return [slope_of(y)]


def test_a_plain_function_is_pickled_by_its_name():
    system = pickle.loads(pickle.dumps(System(as_list, n_states=2)))
    assert system.field.users is as_list
    found = solve(system, (0, 1), [0.0, 0.0], params=PARAMS)
    assert found.y_end[1] == pytest.approx(-9.81, rel=1e-12)


@pytest.mark.parametrize(
    ("function", "kind", "said"),
    [
        (as_list, "field", "returns 2 numbers; expected 3, the number of states"),
        (lambda t, y: 2.0 * y[0], "guards", "returns 1 number; expected 2"),
        (lambda t, y: y[7], "field", r"uses y\[7\], but y has the length 3"),
    ],
)
def test_a_wrong_number_is_told_when_the_system_is_made(function, kind, said):
    callback = Callback(function, SIGNATURES[kind])
    functions = {"field": lambda t, y: y, kind: callback}
    names = ("a", "b") if kind == "guards" else ()
    with pytest.raises(ValueError, match=said):
        System(**functions, n_states=3, guard_names=names)


def test_a_wrong_number_that_only_a_run_shows():
    def grown(t, y):
        rates = zeros(len(y) + 1)
        rates[0] = 1.0
        return rates

    with pytest.raises(ValueError, match="another length than it should"):
        solve(System(grown, n_states=2), (0, 1), [0.0, 0.0])

    def longer(t, y):
        return np.concatenate((y, y))

    said = r"field 'longer' .* returns an array of the shape \(4,\); expected \(2,\)"
    with pytest.raises(TypeError, match=said):
        solve(System(longer, n_states=2), (0, 1), [0.0, 0.0])

    def overflows(t, y, p):
        return y[1], -p[0]

    system = System(overflows, n_states=2)  # what it returns has the right shape
    for options in ({}, {"jacobian": "params"}, {"tstops": [0.5]}):
        run = solve(system, (0, 1), [0.0, 0.0], params=[1e308], **options)
        assert run.status == FIELD_NOT_FINITE
    with pytest.raises(
        ValueError, match=r"uses params\[0\], but params has the length 0"
    ):
        solve(system, (0, 1), [0.0, 0.0], tstops=[0.5])

    def one(t, y):
        return 2.0 * np.max(y)

    with pytest.raises(
        TypeError, match=r"guards 'one' .* shape \(1,\); expected \(2,\)"
    ):
        solve(
            ball(floor=one, guard_names=("a", "b")), (0, 1), [1.0, 0.0], params=PARAMS
        )


def test_a_field_that_is_nan_is_not_called_wrong():
    def nowhere(t, y):
        return y / 0.0

    assert solve(System(nowhere, n_states=2), (0, 1), [0.0, 0.0]).status == -2


def plain_floor(t, y):
    return -y[0]


def test_lanes_take_plain_fields_and_plain_guards():
    starts = np.array([[1.0, 0.0], [2.0, 1.0], [0.5, 3.0]])
    options = {"params": PARAMS, "lanes": True}
    flights = solve_batch(System(unpacked, n_states=2), (0, 1), starts, **options)
    assert flights.lanes.all()
    exact = starts[:, 0] + starts[:, 1] - 9.81 / 2.0
    assert flights.y_end[:, 0] == pytest.approx(exact, abs=1e-8)
    plain = ball(unpacked, plain_floor, handler_in_place)
    bounces = solve_batch(plain, (0, 1), starts, **options)
    assert bounces.lanes.all()
    assert bounces.proven.all()
    own = solve_batch(ball(), (0, 1), starts, params=PARAMS, lanes=False)
    assert bounces.n_events.tolist() == own.n_events.tolist()
    assert bounces.y_end == pytest.approx(own.y_end, rel=1e-9)


@pytest.mark.parametrize(
    ("field", "guard", "message"),
    [
        ("(y[1], -p[3])", "y[0]", r"field .* uses params\[3\], but params has"),
        ("(y[4], -p[1])", "y[0]", r"field .* uses y\[4\], but y has the length 2"),
        ("(y[1], -p[1])", "y[0] + p[2]", r"guards .* uses params\[2\], but params has"),
        ("(y[1], -p[1])", "y[2]", r"guards .* uses y\[2\], but y has the length 2"),
    ],
)
def test_a_lambda_without_known_source_is_checked_like_any_function(
    field, guard, message
):
    """It was typed at a prompt, or made by a program: it is called as it is."""
    functions = [eval(f"lambda t, y, p: {one}") for one in (field, guard)]

    def run():
        system = System(*functions, n_states=2, guard_names=("level",))
        return solve(system, (0.0, 0.1), [1.0, 1.0], params=[1.0, 2.0])

    with pytest.raises(ValueError, match=message):
        run()


def test_a_lambda_without_known_source_runs():
    made = eval("lambda t, y, p: (y[1], -p[1])")
    found = solve(System(made, n_states=2), (0.0, 1.0), [0.0, 0.0], params=[1.0, 2.0])
    np.testing.assert_allclose(found.y_end, [-1.0, -2.0], rtol=1e-12)
