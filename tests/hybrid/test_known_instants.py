"""Known instants: declared, periodic, and those that a field's own code has in time."""

import os

import numpy as np
import pytest
from timed_drives import (
    DRIVES,
    SPAN,
    exact_end,
    instants_within,
    oscillator,
    parameters,
)

from hopdata.hybrid import (
    System,
    every,
    field,
    on_event,
    solve,
    solve_batch,
    solve_ivp,
)
from hopdata.hybrid.gradients import gradient
from hopdata.hybrid.layout import INSTANTS_IN_JACOBIAN, UNSOUGHT_IN_JACOBIAN
from hopdata.hybrid.numbers.switches import switches_in_all_modes

START = [1.0, 0.0]
WIDTH = 1e-6 * SPAN


@pytest.fixture(scope="module")
def systems():
    """Return the oscillators that find their instants, made once."""
    return {name: oscillator(drive) for name, drive in DRIVES.items()}


def error_of(solution, drive, p):
    return np.abs(solution.y_end - exact_end(drive, p, START)).max()


# Found without being told.

#: Each compiles for a second: every third one, or with `ALL=1` all of them.
SOME_DRIVES = [*DRIVES][:: 1 if "ALL" in os.environ else 3]


@pytest.mark.parametrize("name", SOME_DRIVES)
def test_jumps_of_a_drive_are_found(systems, name):
    """Each is an end of a step, at all tolerances, and the error is the tolerance's."""
    drive = DRIVES[name]
    for seed, rtol in ((3, 1e-4), (4, 1e-7), (5, 1e-10)):
        p = parameters(seed)
        found = solve(
            systems[name], (0.0, SPAN), START, params=p, rtol=rtol, atol=1e-2 * rtol
        )
        assert found.success
        inside = instants_within(drive, p)[1:-1]
        nearest = np.abs(found.t[:, None] - inside).min(axis=0)
        assert nearest.max() < 1e-13
        assert error_of(found, drive, p) < 30.0 * rtol


def test_it_takes_fewer_evaluations_than_rejecting_at_each_jump(systems):
    drive = DRIVES["square"]
    plain = oscillator(drive, find_tstops=False)
    p = parameters(6)
    options = {"params": p, "rtol": 1e-7, "atol": 1e-9}
    found = solve(systems["square"], (0.0, SPAN), START, **options)
    rejecting = solve(plain, (0.0, SPAN), START, **options)
    assert found.nfev < 0.5 * rejecting.nfev
    assert error_of(found, drive, p) < error_of(rejecting, drive, p)


def test_a_narrow_pulse_is_stepped_over_only_if_it_is_not_sought(systems):
    drive = DRIVES["narrow pulse"]
    plain = oscillator(drive, find_tstops=False)
    p = parameters(7)
    options = {"params": p, "rtol": 1e-6, "atol": 1e-9}
    found = solve(systems["narrow pulse"], (0.0, SPAN), START, **options)
    blind = solve(plain, (0.0, SPAN), START, **options)
    assert error_of(found, drive, p) < 1e-5
    assert error_of(blind, drive, p) > 1e-3
    told = solve(plain, (0.0, SPAN), START, tstops=[p[4], p[4] + WIDTH], **options)
    assert error_of(told, drive, p) < 1e-5


def test_a_smooth_field_pays_nothing():
    def smooth(t, y):
        return np.sin(3.0 * t) - y[0]

    def on_state(t, y):
        return 1.0 - y[0] if y[0] < 2.0 else t

    assert not System(smooth, n_states=1).has_instants
    assert not System(on_state, n_states=1).has_instants
    assert not oscillator(DRIVES["square"], find_tstops=False).has_instants
    assert oscillator(DRIVES["square"]).has_instants


@field
def chosen_by_state(t, y, mode, params, dy):
    if y[0] > params[0]:
        dy[0] = -1.0 if t < 1.5 else 0.5
    else:
        dy[0] = 1.0 if t % 0.25 < 0.125 else 0.0


def test_jumps_on_the_paths_that_a_state_chooses_are_found():
    """The path is not the one at the start of the step."""
    system = System(chosen_by_state, n_states=1)
    solution = solve(system, (0.0, 1.0), [0.0], params=[9.0], rtol=1e-6)
    nearest = np.abs(solution.t[:, None] - np.arange(1, 8) / 8).min(axis=0)
    assert nearest.max() < 1e-14
    assert solution.y_end == pytest.approx([0.5], abs=1e-12)
    beyond = solve(system, (0.0, 2.0), [20.0], params=[9.0], rtol=1e-6)
    assert np.abs(beyond.t - 1.5).min() < 1e-14
    assert beyond.y_end == pytest.approx([20.0 - 1.5 + 0.25], abs=1e-12)


# Declared.


def step_at_one(t, y):  # to the left of 1, or at it as well
    return 1.0 if t <= 1.0 else -1.0


def step_before_one(t, y):
    return 1.0 if t < 1.0 else -1.0


@pytest.mark.parametrize("function", [step_at_one, step_before_one])
@pytest.mark.parametrize("method", ["dopri5", "dop853", "rosenbrock"])
def test_each_piece_sees_its_own_side(function, method):
    """Whichever side the instant belongs to, no step is rejected."""
    system = System(function, n_states=1, find_tstops=False)
    told = solve(system, (0.0, 3.0), [0.0], tstops=[1.0], method=method)
    assert 1.0 in told.t
    assert told.n_rejected == 0
    assert told.y_end == pytest.approx([-1.0], abs=1e-14)
    late = solve(system, (1.0, 3.0), [0.0], tstops=[1.0], method=method)
    assert late.n_rejected == 0
    assert late.y_end == pytest.approx([-2.0], abs=1e-13)


def wave(t, y, p):
    return 1.0 if (t - p[1]) % p[0] < 0.5 * p[0] else -1.0


def test_instants_may_be_periodic_or_functions_of_the_parameters():
    def own(p):
        return every(p[0], p[1], p[1] + 0.5 * p[0])

    p = [0.3, 0.07]
    options = {"params": p, "rtol": 1e-6, "dense_output": True}
    system = System(wave, n_states=1, find_tstops=False)
    declared = System(wave, n_states=1, find_tstops=False, tstops=own)
    told = solve(system, (0.0, 2.0), [0.0], tstops=own(p), **options)
    itself = solve(declared, (0.0, 2.0), [0.0], **options)
    assert itself.y_end == told.y_end
    found = solve(System(wave, n_states=1), (0.0, 2.0), [0.0], **options)
    assert told.y_end == pytest.approx(found.y_end, abs=1e-13)
    assert told.n_rejected == found.n_rejected == 0
    assert told(1.005) == pytest.approx(found(1.005), abs=1e-13)


def test_backward_in_time_meets_the_same_instants():
    system = System(wave, n_states=1, find_tstops=False)
    p = [0.3, 0.07]
    stops = [every(0.3, 0.07), *(0.22 + 0.3 * np.arange(8))]
    there = solve(system, (0.0, 2.0), [0.0], params=p, tstops=stops)
    back = solve(system, (2.0, 0.0), there.y_end, params=p, tstops=stops)
    found = solve(System(wave, n_states=1), (2.0, 0.0), there.y_end, params=p)
    for one in (there, back, found):
        assert one.n_rejected == 0
    assert back.y_end == pytest.approx([0.0], abs=1e-13)
    assert found.y_end == pytest.approx([0.0], abs=1e-13)


def test_a_batch_has_the_bytes_of_solve(systems):
    system = systems["square"]
    params = np.array([parameters(seed) for seed in range(4)])
    starts = np.tile(START, (4, 1))
    batch = solve_batch(system, (0.0, 5.0), starts, params=params, rtol=1e-6)

    def own(p):
        return [every(p[2], 0.0, p[2] * p[3]), 0.1 * p[4]]

    declared = oscillator(DRIVES["square"], tstops=own, find_tstops=False)
    told = solve_batch(declared, (0.0, 5.0), starts, params=params, rtol=1e-6)
    for row, p in enumerate(params):
        one = solve(system, (0.0, 5.0), START, params=p, rtol=1e-6)
        assert (batch.y_end[row] == one.y_end).all()
        one = solve(declared, (0.0, 5.0), START, params=p, rtol=1e-6)
        assert (told.y_end[row] == one.y_end).all()
        assert told.n_steps[row] == one.n_steps
    in_lanes = solve_batch(
        declared, (0.0, 5.0), starts, params=params, rtol=1e-6, lanes=True
    )
    assert "instants" in in_lanes.lanes_reason
    assert (in_lanes.y_end == told.y_end).all()


def test_the_jacobian_of_the_flow_is_that_of_the_pieces(systems):
    """The oscillator is linear: the drive does not change it."""
    p = parameters(8)
    options = {"params": p, "rtol": 1e-9, "jacobian": True}
    forced = solve(systems["square"], (0.0, 4.0), START, **options)

    def free(t, y, p):
        return y[1], -p[0] * p[0] * y[0] - 2.0 * p[1] * p[0] * y[1]

    unforced = solve(System(free, n_states=2), (0.0, 4.0), START, **options)
    np.testing.assert_allclose(forced.jacobian, unforced.jacobian, atol=1e-7)


def test_derivatives_of_a_field_that_compares_the_time_are_exact():
    """The field is linear, and its drive changes sign at instants that do not move."""

    def driven(t, y, p):
        drive = p[0] if t % 0.9 < 0.36 else -p[0]
        return (-y[0] + drive,)

    system = System(driven, n_states=1)
    end = 2.0
    options = {"params": [0.3], "rtol": 1e-10, "atol": 1e-12}
    along = solve(system, (0.0, end), [0.5], jacobian=True, **options)
    with_p = solve(system, (0.0, end), [0.5], jacobian="params", **options)
    stiff = solve(system, (0.0, end), [0.5], method="rosenbrock", **options)
    assert not along.by_differences
    assert not with_p.by_differences
    assert not stiff.by_differences
    # By y' = -y + p s(t), with the sign s: dy/dp is the integral of exp(u - end) s(u).
    edges = np.array([0.0, 0.36, 0.9, 1.26, 1.8, end])
    signs = np.array([1.0, -1.0, 1.0, -1.0, 1.0])
    by_p = signs @ np.diff(np.exp(edges - end))
    decay = np.exp(-end)
    np.testing.assert_allclose(along.jacobian, [[decay]], rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(with_p.sensitivity, [[by_p]], rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(
        stiff.y_end, [0.5 * decay + 0.3 * by_p], rtol=0.0, atol=1e-8
    )


# Instants that move with the parameters.


def pulsed(t, y, p):
    """Decay, driven by pulses of period p[0] and part p[1], and until p[3]."""
    pulse = p[2] if t % p[0] < p[1] * p[0] else -1.0
    until = 2.0 if t < p[3] else 0.0
    return (-y[0] + pulse + until + p[4],)


PULSES = np.array([0.9, 0.4, 0.3, 1.5, 0.2])


def pulsed_by_params(p, end):
    """The derivative of the end of `pulsed` by its parameters.

    A jump c at time tau adds c exp(tau - end) d tau/dp; between jumps is an integral.
    """
    found = np.zeros(5)
    rises = np.arange(0.0, end, p[0])
    falls = np.minimum(rises + p[1] * p[0], end)
    found[2] = np.sum(np.exp(falls - end) - np.exp(rises - end))
    found[3] = 2.0 * np.exp(p[3] - end)
    found[4] = 1.0 - np.exp(-end)
    height = p[2] + 1.0
    for k, rise in enumerate(rises):
        found[0] -= height * k * np.exp(rise - end)
        fall = rise + p[1] * p[0]
        if fall < end:
            found[0] += height * (k + p[1]) * np.exp(fall - end)
            found[1] += height * p[0] * np.exp(fall - end)
    return found


def test_instants_that_move_with_the_parameters_count_in_the_derivative_by_them():
    """The last parameter is a control: no instant depends on it."""
    system = System(pulsed, n_states=1)
    options = {"rtol": 1e-11, "atol": 1e-13, "jacobian": "params"}
    end = 3.1
    for seed in (61, 62, 63, 64, 65):
        p = PULSES * np.random.default_rng(seed).uniform(0.9, 1.1, 5)
        solution = solve(system, (0.0, end), [0.5], params=p, **options)
        expected = pulsed_by_params(p, end)
        error = np.abs(solution.sensitivity[0] - expected).max()
        assert solution.success, solution.message
        assert error < 1e-9
        assert solution.n_fixed_instants == 0
    batch = solve_batch(system, (0.0, end), [[0.5]], params=[p], **options)
    assert (batch.sensitivity[0] == solution.sensitivity).all()
    assert not batch.instants
    p[3] = 2.0 * p[0]  # two jumps at one instant, which move differently
    tied = solve(system, (0.0, end), [0.5], params=p, **options)
    assert tied.status == INSTANTS_IN_JACOBIAN
    assert "more than one way" in tied.message
    assert solve(system, (0.0, end), [0.5], params=p).success


def square_of_end(t, y, params):
    return y[0] * y[0]


def test_a_gradient_passes_moving_instants():
    """It is the exact one, and that of the forward derivative."""
    system = System(pulsed, n_states=1)
    for seed in (71, 72, 73, 74, 75):
        p = PULSES * np.random.default_rng(seed).uniform(0.9, 1.1, 5)
        options = {"params": p, "rtol": 1e-11, "atol": 1e-13}
        found = gradient(system, (0.0, 3.1), [0.5], at_end=square_of_end, **options)
        forward = solve(system, (0.0, 3.1), [0.5], jacobian="params", **options)
        twice = 2.0 * forward.y_end[0]
        np.testing.assert_allclose(
            found.by_params, twice * forward.sensitivity[0], rtol=0, atol=1e-10
        )
        np.testing.assert_allclose(
            found.by_params, twice * pulsed_by_params(p, 3.1), rtol=0, atol=1e-9
        )
        np.testing.assert_allclose(found.by_start, twice * np.exp(-3.1), atol=1e-10)
    options["params"][3] = 2.0 * p[0]
    tied = gradient(system, (0.0, 3.1), [0.5], at_end=square_of_end, **options)
    assert tied.status == INSTANTS_IN_JACOBIAN


def test_what_is_not_known_of_moving_instants_is_said():
    """Without the search, the jumps are passed over, and the message says so."""
    system = System(pulsed, n_states=1, find_tstops=False)
    options = {"params": PULSES, "jacobian": "params", "rtol": 1e-8}
    loss = {"params": PULSES, "at_end": square_of_end, "rtol": 1e-8}
    assert "find_tstops=False" in gradient(system, (0.0, 3.1), [0.5], **loss).message
    single = solve(system, (0.0, 3.1), [0.5], **options)
    assert "find_tstops=False" in single.message
    error = np.abs(single.sensitivity[0] - pulsed_by_params(PULSES, 3.1))
    assert error[0] > 0.1
    batch = solve_batch(system, (0.0, 3.1), [[0.5]], **options)
    assert "find_tstops=False" in batch.message
    told = solve(system, (0.0, 3.1), [0.5], tstops=[PULSES[3]], **options)
    assert told.n_fixed_instants == 1
    assert "fixed" in told.message
    no_params = solve(system, (0.0, 3.1), [0.5], params=PULSES, jacobian=True)
    assert "find_tstops" not in no_params.message


def test_declared_instants_may_move_with_the_parameters():
    def kicked(t, y, p):
        return (-y[0] + (1.0 if t < p[0] else 3.0),)

    options = {"rtol": 1e-11, "atol": 1e-13, "jacobian": "params", "params": [0.7]}
    system = System(kicked, n_states=1, tstops=lambda p: p[0])
    expected = -2.0 * np.exp(0.7 - 1.0)
    forth = solve(system, (0.0, 1.0), [0.5], **options)
    np.testing.assert_allclose(forth.sensitivity, [[expected]], rtol=0, atol=1e-10)
    back = solve(system, (1.0, 0.0), [0.5], **options)
    np.testing.assert_allclose(back.sensitivity, [[2 * np.exp(0.7)]], rtol=0, atol=1e-9)


def test_a_pattern_is_traced_in_a_field_that_compares_the_time():
    def driven(t, y):
        drive = 1.0 if t % 0.9 < 0.36 else -1.0
        return -y[0] + drive, -3.0 * y[1] + y[0]

    system = System(driven, n_states=2, sparsity="auto")
    stiff = solve(system, (0.0, 1.0), [0.5, 1.0], method="rosenbrock")
    assert stiff.success
    assert not stiff.by_differences


def test_events_beside_instants():
    """A ball on a floor that is pushed, by steps of its own, at the time of an event."""

    def pushed(t, y):
        return y[1], -2.0 if t < 1.0 else 3.0

    def floor(t, y):
        return y[0]

    ball = System(pushed, floor, n_states=2, guard_names=("floor",))
    solution = solve(ball, (0.0, 3.0), [1.0, 0.0], rtol=1e-9)  # meets it at t = 1
    assert solution.events.time[0] == pytest.approx(1.0, abs=1e-12)
    assert solution.success
    end = -2.0 * 2.0 + 0.5 * 3.0 * 4.0
    assert solution.y_end[0] == pytest.approx(end, abs=1e-9)


def test_an_event_may_bring_an_instant_that_was_not_there_before():
    """By the mode, or by the memory of the handler; where neither counts, none does."""

    @field
    def by_mode(t, y, mode, params, dy):
        dy[0] = 1.0
        if mode[1] > 0 and t > 0.7:
            dy[0] = 3.0

    @field
    def by_memory(t, y, mode, params, dy):
        dy[0] = 1.0 + mode[1]
        if t > params[0]:
            dy[0] += 2.0

    def level(t, y):
        return y[0] - 0.3

    @on_event
    def switch(t, y, mode, params, guard, direction):
        mode[1] = 1
        params[0] = 0.7
        return 0

    named = {
        "n_states": 1,
        "n_extra_modes": 1,
        "n_memory": 1,
        "guard_names": ("level",),
    }
    options = {"mode": [-1, 0], "memory": [9.0], "rtol": 1e-6}
    for function, in_all, end in ((by_mode, False, 1.6), (by_memory, True, 2.3)):
        system = System(function, level, switch, **named)
        assert switches_in_all_modes(system.field) == in_all
        solution = solve(system, (0.0, 1.0), [0.0], **options)
        assert np.abs(solution.t - 0.7).min() < 1e-14
        assert solution.y_end == pytest.approx([end], abs=1e-12)
        without = solve(system, (0.0, 1.0), [-5.0], **options)  # no event
        assert np.abs(without.t - 0.7).min() > 1e-3


def test_solve_ivp_takes_them():
    told = solve_ivp(step_before_one, (0, 2), [0.0], tstops=[1.0])
    assert 1.0 in told.t
    assert told.y[0, -1] == pytest.approx(0.0, abs=1e-13)


# Mistakes.


@pytest.mark.parametrize(
    ("wrong", "word"),
    [([np.nan], "finite"), ("soon", "numbers"), ([None], "tstops")],
)
def test_wrong_instants_are_refused(wrong, word):
    with pytest.raises(ValueError, match=word):
        System(step_before_one, n_states=1, tstops=wrong)
    with pytest.raises(ValueError, match=word):
        solve(System(step_before_one, n_states=1), (0, 1), [0.0], tstops=wrong)


def test_wrong_periods_are_refused():
    for period in (0.0, -1.0, np.inf, "day"):
        with pytest.raises(ValueError, match="period"):
            every(period)
    with pytest.raises(ValueError, match="starts"):
        every(1.0, np.nan)


def test_instants_whose_movement_is_not_known_are_refused_if_they_are_functions():
    options = {"tstops": lambda p: every(p[0]), "find_tstops": False}
    system = System(wave, n_states=1, **options)
    with pytest.raises(ValueError, match="find_tstops"):
        solve(system, (0.0, 1.0), [0.0], params=[0.3, 0.0], jacobian="params")


def wrapped(t, y, p):
    return np.arctan(np.tan(p[0] * t + p[1])) - y[0]


def flickers(t, y, p):  # below the tolerance, but faster than times are apart
    return (1e-9 if np.sin(p[0] * t) > 0.0 else -1e-9) - y[0]


def end_of_state(t, y, params):
    return y[0]


def by_differences(system, span, p):
    """Return the derivative of the end by the parameters."""
    found = []
    for step in 1e-6 * np.eye(len(p)):
        ends = [
            solve(system, span, [0.5], params=q).y_end[0] for q in (p + step, p - step)
        ]
        found.append((ends[0] - ends[1]) / 2e-6)
    return found


def test_a_pole_at_the_start_has_no_derivative_and_elsewhere_it_has():
    system = System(wrapped, n_states=1)
    for start, phase in ((0.0, 0.7), (-1.0, np.pi / 2)):  # a pole within, and at t = 0
        p = np.array([2.0, phase])
        found = solve(system, (start, 3.0), [0.5], params=p, jacobian="params")
        assert found.success, found.message
        expected = by_differences(system, (start, 3.0), p)
        np.testing.assert_allclose(found.sensitivity[0], expected, rtol=0, atol=1e-7)
    p = np.array([2.0, np.pi / 2])
    at_start = solve(system, (0.0, 3.0), [0.5], params=p, jacobian="params")
    assert at_start.status == INSTANTS_IN_JACOBIAN
    back = gradient(system, (0.0, 3.0), [0.5], params=p, at_end=end_of_state)
    assert back.status == INSTANTS_IN_JACOBIAN
    assert solve(system, (0.0, 3.0), [0.5], params=p).success


def test_jumps_that_are_not_found_apart_leave_no_derivative_by_the_parameters():
    system = System(flickers, n_states=1)
    options = {"params": [1e18], "rtol": 1e-4, "max_steps": 1000}
    plain = solve(system, (1.0, 2.0), [0.5], **options)
    assert plain.success
    assert plain.n_unsought > 0
    found = solve(system, (1.0, 2.0), [0.5], jacobian="params", **options)
    assert found.status == UNSOUGHT_IN_JACOBIAN
    assert "tstops" in found.message
    batch = solve_batch(system, (1.0, 2.0), [[0.5]], jacobian="params", **options)
    assert batch.status[0] == UNSOUGHT_IN_JACOBIAN
    back = gradient(system, (1.0, 2.0), [0.5], at_end=end_of_state, **options)
    assert back.status == UNSOUGHT_IN_JACOBIAN
    options["params"] = [20.0]
    apart = solve(system, (1.0, 2.0), [0.5], jacobian="params", **options)
    assert apart.success, apart.message
    assert apart.n_unsought == 0
