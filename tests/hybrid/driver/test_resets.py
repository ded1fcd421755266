"""Derivatives through resets, by start and parameters, against exact ones and differences."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ball, fall_field, rebound, throw
from jacobian_checks import TIGHT, carried, differences, gap
from scipy.linalg import expm

from hopdata.hybrid import System, field, guard, guards, on_event, solve, solve_batch
from hopdata.hybrid.first_order import bouligand_derivative
from hopdata.hybrid.layout import GRAZING_IN_JACOBIAN, TIE_IN_JACOBIAN

# Random systems: affine before and after one nonlinear reset, at a plane that moves
# with time.
N = 3
SIZES = {"A0": (N, N), "b0": (N,), "A1": (N, N), "b1": (N,), "plane": (N,), "wave": (3,),
         "R": (N, N), "by_time": (N,), "by_square": (N,)}  # fmt: skip
PLACES = dict(
    zip(SIZES, np.cumsum([0, *(int(np.prod(s)) for s in SIZES.values())]), strict=False)
)
COUNT = sum(int(np.prod(size)) for size in SIZES.values())
A0, B0, A1, B1, PLANE, WAVE, R, BY_TIME, BY_SQUARE = (
    int(PLACES[name]) for name in SIZES
)
END = 1.5
EPS = 1e-30


@field
def drift(t, y, mode, params, dy):
    a, b = (A1, B1) if mode[1] > 0 else (A0, B0)
    for i in range(N):
        dy[i] = params[b + i]
        for j in range(N):
            dy[i] += params[a + N * i + j] * y[j]


@guards
def moving_plane(t, y, dy, mode, params, h, hdot):
    shift = params[WAVE]
    size = params[WAVE + 1]
    rate = params[WAVE + 2]
    h[0] = -shift - size * np.sin(rate * t)
    hdot[0] = -size * rate * np.cos(rate * t)
    for i in range(N):
        h[0] += params[PLANE + i] * y[i]
        hdot[0] += params[PLANE + i] * dy[i]


@guard
def moving_plane_alone(t, y, dy, mode, params, k, h, hdot):
    shift = params[WAVE]
    size = params[WAVE + 1]
    rate = params[WAVE + 2]
    h[k] = -shift - size * np.sin(rate * t)
    hdot[k] = -size * rate * np.cos(rate * t)
    for i in range(N):
        h[k] += params[PLANE + i] * y[i]
        hdot[k] += params[PLANE + i] * dy[i]


@on_event
def kick(t, y, mode, params, guard, direction):
    if mode[1] == 0:
        old = y.copy()
        for i in range(N):
            y[i] = (
                params[BY_TIME + i] * np.cos(t)
                + params[BY_SQUARE + i] * old[0] * old[1]
            )
            for j in range(N):
                y[i] += params[R + N * i + j] * old[j]
        mode[1] = 1
    return 0


OPTIONS = {
    "n_states": N,
    "guard_names": ("plane",),
    "directions": (1,),
    "n_extra_modes": 1,
}
KICKED = System(drift, moving_plane, kick, **OPTIONS)
KICKED_ALONE = System(drift, guard=moving_plane_alone, on_event=kick, **OPTIONS)


def exact_end(y0, params, instant):
    """Return the end for complex starts and parameters; Newton's method finds the event."""
    part = {name: params[at : at + np.prod(SIZES[name])] for name, at in PLACES.items()}
    a0, a1, r = (part[name].reshape(N, N) for name in ("A0", "A1", "R"))

    def flow(a, b, y, span):
        whole = np.zeros((N + 1, N + 1), dtype=complex)
        whole[:N, :N] = a * span
        whole[:N, N] = b * span
        return expm(whole)[:N] @ np.append(y, 1.0)

    shift, size, rate = part["wave"]
    t = complex(instant)
    for _ in range(4):
        y = flow(a0, part["b0"], y0, t)
        h = part["plane"] @ y - shift - size * np.sin(rate * t)
        t -= h / (
            part["plane"] @ (a0 @ y + part["b0"]) - size * rate * np.cos(rate * t)
        )
    y = flow(a0, part["b0"], y0, t)
    y = r @ y + part["by_time"] * np.cos(t) + part["by_square"] * y[0] * y[1]
    return flow(a1, part["b1"], y, END - t)


def random_kicked(rng):
    """Draw a start and parameters with exactly one reset, not too close to a tangent crossing."""
    while True:
        y0 = rng.normal(size=N)
        params = rng.normal(size=COUNT)
        params[WAVE] = params[PLANE : PLANE + N] @ y0 + rng.uniform(0.1, 1.0)
        log = solve(KICKED, (0, END), y0, params=params, rtol=1e-9).events
        if len(log) == 0 or not 0.1 < log.time[0] < END - 0.1:
            continue
        h = np.zeros(1)
        rate = np.zeros(1)
        slope = np.zeros(N)
        mode = np.array([-1, 0])
        KICKED.field.function(log.time[0], log.before[0], mode, params, slope)
        KICKED.guards.function(log.time[0], log.before[0], slope, mode, params, h, rate)
        if rate[0] > 0.2:
            return y0, params, log.time[0]


def by_complex_steps(y0, params, instant, chosen):
    """Return derivatives with respect to the start and the chosen parameters."""
    state = [
        exact_end(y0 + 1j * EPS * e, params + 0j, instant).imag / EPS for e in np.eye(N)
    ]
    shifts = np.eye(COUNT)[chosen] * 1j * EPS
    return np.array(state).T, np.array(
        [exact_end(y0 + 0j, params + shift, instant).imag / EPS for shift in shifts]
    ).T


@pytest.mark.parametrize("method", ["dop853", "dopri5"])
@pytest.mark.parametrize("system", [KICKED, KICKED_ALONE], ids=["guards", "guard"])
def test_random_resets_agree_with_complex_steps(system, method):
    rng = np.random.default_rng(27)
    worst = 0.0
    for _ in range(100):
        y0, params, instant = random_kicked(rng)
        found = carried(system, (0, END), y0, params=params, method=method)
        right, _ = by_complex_steps(y0, params, instant, [])
        worst = max(worst, gap(found.jacobian, right))
    assert worst < 1e-8


def test_random_resets_by_all_parameters_agree_with_complex_steps():
    rng = np.random.default_rng(28)
    worst = 0.0
    for _ in range(100):
        y0, params, instant = random_kicked(rng)
        chosen = rng.choice(COUNT, size=6, replace=False)
        options = {"params": params, "jacobian": "params", "method": "dop853", **TIGHT}
        found = solve(KICKED, (0, END), y0, **options)
        state, by_params = by_complex_steps(y0, params, instant, chosen)
        assert found.y.shape[0] == found.events.before.shape[1] == N
        assert found.sensitivity.shape == (N, COUNT)
        worst = max(worst, gap(found.jacobian, state))
        scale = np.abs(found.sensitivity).max()
        worst = max(
            worst, np.abs(found.sensitivity[:, chosen] - by_params).max() / scale
        )
    assert worst < 1e-8
    batch = solve_batch(KICKED, (0, END), [y0, y0], **options)
    assert batch.sensitivity[1].tobytes() == found.sensitivity.tobytes()
    assert batch.y_end[1].tobytes() == found.y_end.tobytes()


def test_random_resets_agree_with_differences():
    rng = np.random.default_rng(29)
    for _ in range(20):
        y0, params, _ = random_kicked(rng)
        found = carried(KICKED, (0, END), y0, params=params)
        assert (
            gap(found.jacobian, differences(KICKED, (0, END), y0, params=params)) < 1e-8
        )


def test_a_bouncing_ball():
    """The lock flips there and back at each bounce."""
    system = ball()
    options = {"params": (2.0, 0.0, 0.5), "method": "dop853"}
    found = carried(system, (0, 2.6), [1.0, 0.3], **options)
    assert len(found.events) == 4
    assert (
        gap(found.jacobian, differences(system, (0, 2.6), [1.0, 0.3], **options)) < 1e-9
    )
    given = solve(system, (0, 2.6), [1.0, 0.3], jacobian="params", **TIGHT, **options)
    steps = []
    for j in range(3):
        shift = 1e-4 * np.eye(3)[j]
        ends = [
            solve(
                system,
                (0, 2.6),
                [1.0, 0.3],
                params=(2.0, 0.0, 0.5) + c * shift,
                **TIGHT,
            ).y_end
            for c in (-2, -1, 1, 2)
        ]
        steps.append(np.array([1, -8, 8, -1]) @ ends / 12e-4)
    assert given.sensitivity == pytest.approx(np.array(steps).T, abs=1e-8)


@field
def fall_on(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -9.81


@guards
def shaking_table(t, y, dy, mode, params, h, hdot):
    phase = params[1] * t
    h[0] = params[0] * np.sin(phase) - y[0]
    hdot[0] = params[0] * params[1] * np.cos(phase) - dy[0]
    h[1] = params[2] - y[0]
    hdot[1] = -dy[0]


@on_event
def off_the_table(t, y, mode, params, guard, direction):
    if guard == 0 and direction > 0:
        y[1] = 1.8 * params[0] * params[1] * np.cos(params[1] * t) - 0.8 * y[1]
    return 0


@pytest.mark.parametrize("above_m", [1.0, 1e-9])
@pytest.mark.parametrize("frequency", [5.0, 157.0, 600.0])
def test_a_table_that_shakes_quickly_beside_the_fall(frequency, above_m):
    """Another guard lies just above it; neither fall nor gap has the time scale of the table."""
    size = 1e-3
    start = np.array([500.0, 0.0])
    end = 12.0
    table = System(
        fall_on,
        shaking_table,
        off_the_table,
        n_states=2,
        guard_names=("table", "level"),
    )
    params = (size, frequency, above_m)
    options = {"params": params, "jacobian": "params", "method": "dopri5", **TIGHT}
    found = solve(table, (0, end), start, **options)
    t = found.events.of("table").time[0]
    before = found.events.of("table").before[0]
    speed = size * frequency * np.cos(frequency * t)
    changes = np.array(
        [1.0, t, size * t * np.cos(frequency * t)]
    )  # of the gap, with respect to y0 and frequency
    changes[2] *= -1.0
    dt = changes / (speed - before[1])
    fall = np.array([0.0, 1.0, 0.0])
    bend = -size * frequency**2 * np.sin(frequency * t)
    by_frequency = size * np.cos(frequency * t) - size * frequency * t * np.sin(
        frequency * t
    )
    hit = np.array([1.0, t, 0.0]) + before[1] * dt
    after = 1.8 * (bend * dt + [0, 0, by_frequency]) - 0.8 * (fall - 9.81 * dt)
    left = end - t
    speed_after = 1.8 * speed - 0.8 * before[1]
    ends = [hit + after * left - speed_after * dt + 9.81 * left * dt, after + 9.81 * dt]
    got = np.column_stack([found.jacobian, found.sensitivity[:, 1]])
    assert got == pytest.approx(np.array(ends), rel=1e-6, abs=1e-7)


@field
def wheel_field(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = np.sin(y[0])


@guards
def next_spoke(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] - params[0] - params[1]
    hdot[0] = dy[0]


@on_event
def change_spoke(t, y, mode, params, guard, direction):
    if direction > 0:
        y[0] -= 2.0 * params[0]
        y[1] *= np.cos(2.0 * params[0])
    return 0


def test_a_reset_that_pushes_its_guard_back():
    """In a rimless wheel, the next spoke is far from the floor, so its lock falls at once."""
    wheel = System(
        wheel_field, next_spoke, change_spoke, n_states=2, guard_names=("spoke",)
    )
    options = {"params": (0.3, 0.1)}
    found = carried(wheel, (0, 3.0), [0.0, 0.8], **options)
    assert len(found.events) == 6
    assert (
        gap(found.jacobian, differences(wheel, (0, 3.0), [0.0, 0.8], **options)) < 1e-8
    )


@on_event
def push(t, y, mode, params, guard, direction):
    if guard == 0:
        y[0] += 0.5 * y[1]  # beyond the second plane
    return 0


@guards
def two_planes(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] - params[0]
    hdot[0] = dy[0]
    h[1] = y[0] - params[1]
    hdot[1] = dy[0]


@field
def faster(t, y, mode, params, dy):
    dy[0] = y[1] + 0.2 * np.sin(t)
    dy[1] = 0.1 * y[0]
    if mode[1] > 0:
        dy[0], dy[1] = dy[0] + 1.0, dy[1] - 0.7 * y[0]


def test_a_reset_that_pushes_another_guard():
    system = System(
        faster, two_planes, push, n_states=2, guard_names=("first", "second")
    )
    pushed = carried(system, (0, 1.5), [0.0, 1.0], params=(0.5, 0.7))
    assert np.ptp(pushed.events.time) == 0.0
    right = differences(system, (0, 1.5), [0.0, 1.0], params=(0.5, 0.7))
    assert gap(pushed.jacobian, right) < 1e-9
    tied = carried(system, (0, 1.5), [0.0, 1.0], params=(0.5, 0.5))
    assert tied.status == TIE_IN_JACOBIAN
    assert "Several guards flip" in tied.message


@field
def wind(t, y, mode, params, dy):
    dy[0], dy[1] = 1.0 + 0.3 * np.sin(y[1]), 0.0
    if mode[0] > 0:
        dy[1] = 0.4 + 0.2 * y[0]
    if mode[1] > 0:
        dy[0], dy[1] = dy[0] - 0.5, 2.0 * dy[1]


@guards
def place_and_line(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0] - 0.5 - 0.2 * y[1] ** 2, dy[0] - 0.4 * y[1] * dy[1]
    h[1], hdot[1] = y[1], dy[1]


def onto_line(t, y, mode, params, guard, direction):
    if guard == 1:
        mode[2] += int(params[1])
    elif params[0] == 0.0:
        y[1] -= 3.0 * (y[1] / 3.0)  # onto the line, but for rounding
    else:
        y[1] += params[0]
    return 0


@pytest.mark.parametrize("compiled", [True, False])  # by duals, and by differences
@pytest.mark.parametrize(
    ("params", "exists"),
    [
        ((0.0, 0.0), True),  # all are put onto the line, and cross it
        ((0.5, 0.0), False),  # one start alone: its neighbours miss the line
        ((0.499, 0.0), True),
        ((0.501, 0.0), True),
        ((0.0, 1.0), False),  # those that are beyond by rounding set no mode
    ],
)
def test_a_reset_that_puts_the_state_onto_another_surface(params, exists, compiled):
    handler = on_event(compiled=compiled)(onto_line)
    system = System(
        wind, place_and_line, handler, n_states=2, guard_names=("place", "line"),
        n_extra_modes=1,
    )  # fmt: skip
    options = {"params": params, "mode": [-1, -1, 0]}
    found = carried(system, (0, 1.5), [0.0, -0.5], **options)
    if not exists:
        assert found.status == TIE_IN_JACOBIAN
        return
    right = differences(system, (0, 1.5), [0.0, -0.5], **options)
    assert gap(found.jacobian, right) < 1e-9


@guards
def one_plane(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] - params[0]
    hdot[0] = dy[0]


@field
def add_up(t, y, mode, params, dy):
    dy[0] = 1.0
    dy[1] = 0.0
    dy[2] = y[1]


@on_event
def clear(t, y, mode, params, guard, direction):
    y[1] = 0.0
    return 0


@pytest.mark.parametrize("speed", [0.0, 0.5])
def test_a_reset_to_the_value_that_the_state_has(speed):
    system = System(add_up, one_plane, clear, n_states=3, guard_names=("plane",))
    right = [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-speed, 1.0, 1.0]]
    found = solve(
        system, (0, 2), [0.0, speed, 0.0], params=(1.0,), jacobian=True
    ).jacobian
    np.testing.assert_allclose(found, right, rtol=0, atol=1e-10)
    at_once = bouligand_derivative(system, [1.0, speed, 0.0], params=(1.0,), mode=[-1])
    np.testing.assert_allclose(
        at_once(np.eye(3)), [*right[:2], [-speed, 0, 1]], rtol=0, atol=1e-10
    )


def test_where_a_guard_is_grazed_there_is_no_derivative():
    options = {"params": (2.0, 1.0), "mode": [-1], "method": "dopri5"}
    for above, right in (
        (1e-12, GRAZING_IN_JACOBIAN),
        (1e-10, GRAZING_IN_JACOBIAN),
        (1e-4, 0),
    ):
        found = solve(throw(), (0, 1.7), [0.0, 2.0 + above], jacobian=True, **options)
        assert found.status == right, (above, found)
        assert right == 0 or "'ceiling' is grazed at t = " in found.message
        assert len(solve(throw(), (0, 1.7), [0.0, 2.0 + above], **options).events) == 2


def test_a_handlers_memory_and_mode_are_those_of_the_run():
    """The reset is differentiated by calling it on other states, which must leave no trace."""

    @on_event
    def note(t, y, mode, params, guard, direction):
        if direction > 0:
            mode[1] += 1
            params[3] += y[1]
            y[1] *= -0.5
        return 0

    options = {
        "n_states": 2,
        "guard_names": ("floor",),
        "n_extra_modes": 1,
        "n_memory": 1,
    }
    system = System(fall_field, ball().guards, note, **options)
    options = {
        "params": (2.0, 0.0, 0.5),
        "method": "dop853",
    }  # for the ball, which is compiled
    plain = solve(system, (0, 2.6), [1.0, 0.3], **options)
    found = solve(system, (0, 2.6), [1.0, 0.3], jacobian=True, **options)
    assert found.mode.tolist() == plain.mode.tolist() == [-1, 2]
    assert len(found.events) == len(plain.events) == 4
    with pytest.raises(ValueError, match="n_memory"):
        solve(system, (0, 2.6), [1.0, 0.3], params=(2.0, 0.0, 0.5), jacobian="params")
    with pytest.raises(ValueError, match="found 'parameters'"):
        solve(
            ball(on_event=rebound),
            (0, 1),
            [1.0, 0.0],
            params=(2, 0, 1),
            jacobian="parameters",
        )
