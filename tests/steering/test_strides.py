"""Strides of any robot: axes, rows, next states, and tables that come back."""

import numpy as np
import pytest

from hopdata.errors import AnalysisError, ConfigError, RecordingError
from hopdata.rigid import composed
from hopdata.steering import strides as table
from hopdata.steering.frame_changes import HOPPER, FrameChanges, hopper_axes
from hopdata.steering.strides import Input, State, StrideAxes

LEG = Input(name="leg_angle", lower=-0.5, upper=0.5)
PUSH = Input(name="push", unit="n", lower=0.0, upper=20.0)
# One state of each kind: moved, set by an input, and to be learned.
WALKER = StrideAxes(
    periodic=(State(name="phase", moved_by="leg_angle"),),
    linear=(
        State(name="speed", unit="m_s"),
        State(name="last_push", unit="n", set_by="push"),
    ),
    inputs=(LEG, PUSH),
)


def walked(n=6, seed=0):
    """Return poses, states and inputs of n stances of a walker."""
    rng = np.random.default_rng(seed)
    inputs = rng.uniform(WALKER.lower, WALKER.upper, (n, 2))
    state = np.column_stack(
        [np.append(5.0, 5.0 + np.cumsum(inputs[:-1, 0])), rng.uniform(0, 1, (n, 2))]
    )
    state[1:, 2] = inputs[:-1, 1]
    poses = [np.array([0.3, -0.2, 3.0])]
    for _ in range(n - 1):
        poses.append(composed(poses[-1], rng.uniform(-0.2, 0.2, 3)))
    return np.array(poses), state, inputs


def collected(poses, state, inputs, **options):
    time_s = 0.5 * np.arange(len(poses))
    return table.recorded_strides(
        WALKER, time_s=time_s, pose=poses, state=state, inputs=inputs, **options
    )


def test_strides_lead_from_stance_to_stance():
    poses, state, inputs = walked()
    found = collected(poses, state, inputs)
    np.testing.assert_allclose(
        composed(poses[:-1], found.change)[:, :2], poses[1:, :2], atol=1e-12
    )
    np.testing.assert_array_equal(found.inputs, inputs[:-1])
    np.testing.assert_allclose(found.state[1:], found.next_state[:-1], atol=1e-12)
    assert found.state[:, 0].max() < 2 * np.pi
    assert found.excluded() == {}
    np.testing.assert_array_equal(found.column("push"), inputs[:-1, 1])
    with pytest.raises(KeyError):
        found.column("pull")


def test_known_next_states_are_those_that_were_seen_and_the_others_are_unknown():
    found = collected(*walked())
    after = WALKER.next_state(found.state, found.inputs)
    np.testing.assert_allclose(after[:, [0, 2]], found.next_state[:, [0, 2]])
    assert np.isnan(after[:, 1]).all()
    assert WALKER.is_known.tolist() == [True, False, True]


def test_what_is_not_used_has_its_reason():
    poses, state, inputs = walked()
    poses[0] = np.nan
    state[2, 1] = np.nan  # the state at the end of one stride, and before the next
    inputs[3, 0] = 0.51
    inputs[4, 1] = np.nan
    found = collected(poses, state, inputs)
    assert found.reason.tolist() == [
        table.NO_POSE,
        table.NO_STATE,
        table.NO_STATE,
        table.FAR_INPUT,
        table.NO_INPUT,
    ]
    assert len(found.used()) == 0
    pairs = np.array([[1, 0], [5, 4]])
    assert len(collected(*walked(), pairs=pairs).used()) == 2


# Deviations with which a pose is seen: m, m, rad.
SEEN = np.array([0.002, 0.002, 0.005])


def excited_walker(*, seed, fallen=(), ahead_m=0.1, turn_rad=0.3, n=100):
    """Return strides with random inputs; from those in `fallen` on, it lies still."""
    rng = np.random.default_rng(seed)
    share = rng.uniform(-1.0, 1.0, (n, 2))  # of both inputs
    change = np.column_stack(
        [ahead_m * share[:, 0], np.zeros(n), turn_rad * share[:, 1]]
    )
    change[list(fallen)] = 0.0
    poses = np.zeros((n + 1, 3))
    for k in range(n):
        poses[k + 1] = composed(poses[k], change[k])
    poses += SEEN * rng.standard_normal(poses.shape)
    inputs = np.column_stack([0.5 * share[:, 0], 10 + 10 * share[:, 1]])
    inputs = np.vstack([inputs, [np.nan, np.nan]])
    return collected(poses, np.ones((n + 1, 3)), inputs)


@pytest.mark.parametrize("seed", range(5))
def test_strides_of_a_robot_that_lies_are_not_used_and_told(seed):
    found = excited_walker(seed=seed, fallen=range(60, 100))
    # The stride before is the one in which it fell; the first to lie may look livelier.
    assert 40 <= found.excluded()[table.FALLEN] <= 43
    assert "narrower limits" in found.fall()
    assert f"from {found.time_s[found.reason != ''][0]:.1f} s on" in found.fall()
    # It was put up again, and the rest of its strides are used.
    again = excited_walker(seed=seed, fallen=range(20, 50))
    assert 30 <= again.excluded()[table.FALLEN] <= 33
    assert (again.reason[55:] == "").all()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("slow", [{}, {"ahead_m": 0.0}, {"turn_rad": 0.0}])
def test_strides_of_a_robot_that_stands_now_and_then_are_used(seed, slow):
    now_and_then = [20, 21, 22, 23, 40, 41, 60]
    found = excited_walker(seed=seed, fallen=now_and_then, **slow)
    assert found.excluded() == {}
    assert found.fall() == ""
    few = excited_walker(seed=seed, n=5)
    assert few.excluded() == {}


def test_a_table_of_any_robot_comes_back():
    both = table.joined([collected(*walked()), collected(*walked(seed=1))])
    written = table.to_table(both)
    assert list(written) == [
        *("recording", "time_s", "phase_rad", "speed_m_s", "last_push_n"),
        *("leg_angle_rad", "push_n", "dx_m", "dy_m", "dtheta_rad"),
        *("next_speed_m_s", "reason"),
    ]
    back = table.from_table(written, WALKER)
    for name in ("state", "inputs", "change", "reason"):
        np.testing.assert_array_equal(getattr(back, name), getattr(both, name))
    np.testing.assert_allclose(back.next_state, both.next_state, atol=1e-12)
    with pytest.raises(RecordingError, match="missing next_speed_m_s"):
        table.from_table(written.drop(columns="next_speed_m_s"), WALKER)


def test_the_hopper_has_the_columns_that_it_always_had():
    assert table.columns_of(HOPPER) == [
        *("recording", "time_s", "boom_angle_rad", "swing_rad"),
        *("dx_m", "dy_m", "dtheta_rad", "reason"),
    ]
    hops = FrameChanges.hops(
        recording=np.array(["a"]),
        time_s=np.zeros(1),
        boom_angle_rad=np.array([6.0]),
        swing_rad=np.array([0.5]),
        change=np.zeros((1, 3)),
        reason=np.array([""]),
    )
    np.testing.assert_allclose(hops.next_state, [[6.5 - 2 * np.pi]])
    assert isinstance(hops.used(), FrameChanges)
    assert hops.used().swing_rad.tolist() == [0.5]


def test_one_state_and_one_input_may_be_plain_numbers():
    axes = hopper_axes(1.0)
    np.testing.assert_array_equal(axes.points(3.0, [0.1, 0.2]), [[3, 0.1], [3, 0.2]])
    np.testing.assert_array_equal(axes.points([3.0, 4.0], 0.1), [[3, 0.1], [4, 0.1]])
    np.testing.assert_array_equal(axes.points([[3.0]], [[0.1]]), [[3, 0.1]])
    assert axes.points([], 0.1).shape == (0, 2)
    state = [1.0, 2.0, 3.0]
    assert WALKER.points(state, np.zeros((4, 2))).shape == (4, 5)
    for wrong in ([1.0, 2.0], np.zeros((4, 2)), 1.0):
        with pytest.raises(AnalysisError, match=r"expected states \(n, 3\)"):
            WALKER.points(wrong, np.zeros((4, 2)))
    with pytest.raises(AnalysisError, match=r"of one length, found \[2, 3\]"):
        axes.points(np.zeros(2), np.zeros(3))


@pytest.mark.parametrize(
    ("axes", "said"),
    [
        (lambda: StrideAxes(inputs=()), "at least one"),
        (lambda: StrideAxes(inputs=(LEG, LEG)), "leg_angle"),
        (
            lambda: StrideAxes(
                periodic=(State(name="a", moved_by="b"),), inputs=(LEG,)
            ),
            "one of the inputs leg_angle",
        ),
        (
            lambda: StrideAxes(periodic=(State(name="a", unit="m"),), inputs=(LEG,)),
            "an angle in rad",
        ),
        (lambda: Input(name="a", lower=1.0, upper=1.0), "the lower first"),
        (lambda: Input(name="a", lower=0.0, upper=np.inf), "two finite numbers"),
        (lambda: State(name="a", moved_by="b", set_by="b"), "either moved_by or"),
    ],
)
def test_axes_are_checked(axes, said):
    with pytest.raises(ConfigError, match=said):
        axes()


def test_columns_of_other_shapes_are_an_error():
    found = vars(collected(*walked()))
    narrow = found | {"inputs": found["inputs"][:, :1]}
    with pytest.raises(ValueError, match=r"inputs: expected \(5, 2\), found \(5, 1\)"):
        table.Strides(**narrow)
