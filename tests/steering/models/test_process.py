"""Processes: the closed form, any robot, periodicity, and files."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest
from steered_hops import LIMIT, WALKER, chained_hops, smooth_change, walked_strides

from hopdata.errors import AnalysisError, ConfigError, RecordingError
from hopdata.steering.frame_changes import HOPPER, hopper_axes
from hopdata.steering.models.kernels import SMOOTHNESSES
from hopdata.steering.models.process import FrameChangeProcess
from hopdata.steering.models.process_file import MOST_POINTS, load_process, save_process
from hopdata.steering.models.training import (
    PRINTED,
    RECOMMENDED,
    ProcessOptions,
    axis_units,
    fitted_regressor,
    hyper_parameters,
    trained_process,
    training_set,
    without_copies,
)

NOISE = np.array([2e-3, 2e-3, 1e-2])
HOPS = chained_hops(60, noise=NOISE)
SETUPS = {
    "recommended": RECOMMENDED,
    "printed": PRINTED,
    "one scale": replace(RECOMMENDED, own_scales=False),
    "copies": replace(RECOMMENDED, periodic=False, restarts=0),
    "rough": replace(RECOMMENDED, smoothness=0.5),
    "C2": replace(RECOMMENDED, smoothness=2.5),
    "Gaussian": replace(RECOMMENDED, smoothness=np.inf),
}


@pytest.fixture(scope="module", params=SETUPS)
def trained(request):
    """Return a set-up, its process, and points at which to evaluate it."""
    options = SETUPS[request.param]
    hops = chained_hops(30, seed=9)
    points = np.column_stack([hops.boom_angle_rad, hops.swing_rad])
    return options, trained_process(HOPS, options), points


def closed_form(process, points):
    """Return mean and sd (n, J) of a process as Rasmussen and Williams write them."""
    apart = points[:, None] - process.points
    trained_apart = process.points[:, None] - process.points
    means, sds = [], []
    for j, lengths in enumerate(process.length_scales):
        crossed, covariance = (
            process.variance[j] * matern_of(process, differences, lengths)
            for differences in (apart, trained_apart)
        )
        covariance[np.diag_indices(len(covariance))] += process.noise[j]
        target = (process.outputs[:, j] - process.offset[j]) / process.unit[j]
        mean = crossed @ np.linalg.solve(covariance, target)
        explained = crossed * np.linalg.solve(covariance, crossed.T).T
        variance = process.variance[j] - explained.sum(axis=1)
        means.append(process.offset[j] + process.unit[j] * mean)
        sds.append(process.unit[j] * np.sqrt(variance))
    return np.column_stack(means), np.column_stack(sds)


def matern_of(process, differences, lengths):
    """Return the kernel of differences (n, m, D), angles by the chord of the circle."""
    n = process.n_embedded
    chords = differences.copy()
    chords[..., :n] = 2 * np.sin(differences[..., :n] / 2)
    squared = ((chords / lengths) ** 2).sum(axis=-1)
    if process.smoothness == np.inf:
        return np.exp(-squared / 2)
    r = np.sqrt(2 * process.smoothness * squared)
    polynomial = {0.5: 1.0, 1.5: 1 + r, 2.5: 1 + r + r**2 / 3}[process.smoothness]
    return polynomial * np.exp(-r)


@pytest.mark.parametrize("seed", range(6))
def test_mean_and_sd_are_those_of_the_closed_form(seed):
    rng = np.random.default_rng(seed)
    axes = (HOPPER, WALKER)[seed % 2]
    n_axes = len(axes.axes)
    n_outputs = 3 + int((~axes.is_known).sum())
    process = FrameChangeProcess(
        axes=axes,
        smoothness=SMOOTHNESSES[seed % 4],
        periodic=seed != 4,
        points=rng.uniform(0, 6, (40, n_axes)),
        outputs=rng.standard_normal((40, n_outputs)),
        offset=rng.standard_normal(n_outputs),
        unit=rng.uniform(0.1, 10, n_outputs),
        variance=rng.uniform(0.5, 2, n_outputs),
        noise=rng.uniform(0.05, 0.5, n_outputs),
        length_scales=rng.uniform(0.5, 3, (n_outputs, n_axes)),
    )
    points = rng.uniform(0, 6, (20, n_axes))
    mean, sd = closed_form(process, points)
    np.testing.assert_allclose(process.mean_at(points), mean[:, :3], rtol=1e-12)
    np.testing.assert_allclose(process.sd_at(points), sd[:, :3], rtol=1e-12)


def test_hyper_parameters_are_those_that_scikit_learn_found(trained):
    options, process, _ = trained
    targets = (process.outputs - process.offset) / process.unit
    scale = axis_units(without_copies(process)[0], options)
    peer = fitted_regressor(process.points / scale, targets[:, 1], options, 0)
    assert hyper_parameters(peer, 2)[2] == process.noise[1]


def test_a_whole_turn_more_is_the_same_hop(trained):
    _, process, points = trained
    turned = points.copy()
    turned[:, 0] += 4 * np.pi
    np.testing.assert_allclose(
        process.change(*turned.T), process.change(*points.T), atol=1e-12
    )
    np.testing.assert_allclose(process.sd(*turned.T), process.sd(*points.T), atol=1e-9)


def test_the_sd_of_a_hop_has_the_noise_in_it(trained):
    _, process, points = trained
    expectation, hop = process.sd(*points.T), process.sd(*points.T, observed=True)
    noise = np.sqrt(process.noise) * process.unit
    np.testing.assert_allclose(np.hypot(expectation, noise), hop, rtol=1e-9)


def test_a_process_comes_back_from_its_file(trained, tmp_path):
    _, process, points = trained
    save_process(tmp_path / "process.npz", process)
    back = load_process(tmp_path / "process.npz")
    np.testing.assert_array_equal(back.change(*points.T), process.change(*points.T))
    assert back.periodic == process.periodic
    assert back.axes == process.axes
    # The table is read, not computed again.
    assert "regressors" not in vars(load_process(tmp_path / "process.npz"))
    np.testing.assert_array_equal(back.table.values, process.table.values)


def test_a_smooth_map_is_learned_from_100_hops():
    process = trained_process(chained_hops(100, noise=NOISE / 10))
    test = chained_hops(300, seed=5)
    angle, swing = test.boom_angle_rad, test.swing_rad
    error = process.change(angle, swing) - smooth_change(angle, swing)
    assert np.sqrt(np.mean(error**2, axis=0))[0] < 5e-4
    assert (1 - np.mean(error**2, axis=0) / test.change.var(axis=0)).min() > 0.99


def test_units_do_not_matter_to_standardised_processes():
    in_cm = replace(HOPS, change=HOPS.change * [100, 100, 1])
    a, b = trained_process(HOPS), trained_process(in_cm)
    np.testing.assert_allclose(
        b.change(1.0, 0.3)[0], a.change(1.0, 0.3)[0] * [100, 100, 1], rtol=1e-5
    )


def test_the_printed_set_up_is_the_printed_formula():
    process = trained_process(HOPS, PRINTED)
    assert len(process.points) == 3 * len(HOPS)
    assert process.points[:, 0].min() < -np.pi < 3 * np.pi < process.points[:, 0].max()
    assert np.all(process.variance == 1)
    assert np.all(process.noise == 0.1)
    assert np.all(process.length_scales == 1)
    # Matern kernel of smoothness 3/2 by the formula with its Bessel function.
    from scipy.special import gamma, kv

    distance = np.array([0.3, 1.0, 2.0])
    root = np.sqrt(3) * distance
    printed = root**1.5 * kv(1.5, root) / (gamma(1.5) * np.sqrt(2))
    swings = np.column_stack([np.zeros(3), distance])
    found = process.kernel(0)(np.zeros((1, 2)), swings)[0]
    np.testing.assert_allclose(found, printed, rtol=1e-12)


def test_excluded_hops_teach_nothing():
    reason = HOPS.reason.astype("<U32")
    reason[::2] = "pose missing"
    assert len(training_set(replace(HOPS, reason=reason))[0]) == 30
    with pytest.raises(AnalysisError, match=r"at least 10 hops .* found 9 of 18"):
        training_set(replace(HOPS, reason=reason).rows(np.arange(18)))


def test_inputs_are_checked():
    process = trained_process(HOPS)
    with pytest.raises(AnalysisError, match=r"of one length, found \[2, 3\]"):
        process.change(np.zeros(2), np.zeros(3))


def test_a_single_number_holds_for_all_hops_and_no_hops_are_no_trouble():
    process = trained_process(HOPS)
    angles = np.array([0.1, 2.0])
    both = process.change(angles, np.full(2, 0.3))
    np.testing.assert_array_equal(process.change(angles, 0.3), both)
    assert process.change(np.zeros(0), 0.3).shape == (0, 3)
    assert process.sd(np.zeros(0), 0.3).shape == (0, 3)


def test_hops_alike_without_noise_are_an_error():
    one = trained_process(HOPS)
    twice = replace(one, points=np.tile(one.points[:1], (60, 1)), noise=np.zeros(3))
    with pytest.raises(AnalysisError, match="positive definite"):
        twice.change(0.0, 0.0)


@pytest.mark.parametrize(("key", "value"), [("smoothness", 2.0), ("noise", 0.0)])
def test_options_are_checked(key, value):
    with pytest.raises(ConfigError, match=key):
        ProcessOptions(**{key: value})


def test_another_file_is_no_process(tmp_path):
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    (tmp_path / "text.npz").write_text("not an archive")
    (tmp_path / "empty.npz").touch()
    (tmp_path / "folder.npz").mkdir()
    np.save(tmp_path / "single.npy", np.zeros(3))
    shapeless = {field.name: np.zeros(3) for field in fields(FrameChangeProcess)}
    np.savez(tmp_path / "shapeless.npz", **shapeless)
    for file in tmp_path.iterdir():
        with pytest.raises(
            RecordingError,
            match=f"{file.name}: expected a trained process .*(another|folder)",
        ):
            load_process(file)
    with pytest.raises(
        RecordingError, match=r"none\.npz: expected .*, found: No such file"
    ):
        load_process(tmp_path / "none.npz")


def test_a_table_is_within_the_limits_of_the_input():
    process = replace(trained_process(HOPS), axes=hopper_axes(LIMIT))
    limit = np.array([LIMIT])
    assert process.table.axes.has_limits(-limit, limit)
    assert process.within(-limit, limit) is process.table
    assert process.within(-limit / 2, limit / 2).axes.upper == LIMIT / 2
    walker = trained_process(walked_strides(40), replace(RECOMMENDED, restarts=0))
    assert walker.table is None


def test_a_robot_with_more_states_and_inputs_is_learned(tmp_path):
    options = replace(RECOMMENDED, restarts=0)
    process = trained_process(walked_strides(150), options)
    save_process(tmp_path / "walker.npz", process)
    process = load_process(tmp_path / "walker.npz")
    fresh = walked_strides(200, seed=1)
    error = process.change(fresh.state, fresh.inputs) - fresh.change
    assert (1 - (error**2).mean(axis=0) / fresh.change.var(axis=0)).min() > 0.95
    after = process.next_state(fresh.state, fresh.inputs)
    assert np.all((after[:, :2] >= 0) & (after[:, :2] < 2 * np.pi))
    missed = after - fresh.next_state
    missed[:, :2] = (missed[:, :2] + np.pi) % (2 * np.pi) - np.pi
    # Of phase, gait, speed and last push, the first and the last are known.
    np.testing.assert_allclose(missed[:, [0, 3]], 0.0, atol=1e-12)
    spread = (fresh.next_state - fresh.state).std(axis=0)
    assert missed[:, 1].std() < 0.05
    assert missed[:, 2].std() < 0.1 * spread[2]


def test_an_increment_of_nearly_half_a_turn_has_no_jump():
    walked = walked_strides(40)
    moved = walked.next_state.copy()
    moved[:, 1] = walked.state[:, 1] + np.pi + 0.3 * np.sin(np.arange(40))
    moved[:, 1] %= 2 * np.pi
    outputs = training_set(replace(walked, next_state=moved))[1]
    assert np.ptp(outputs[:, 3]) < 0.7


def test_the_limit_of_the_test_hops_is_the_robot_s():
    assert pytest.approx(3 * np.pi / 8) == LIMIT


def as_json(axes):
    """Return axes as they stand in a file."""
    return np.frombuffer(json.dumps(axes).encode(), dtype=np.uint8)


def arrays(**given):
    """Return the arrays of a file, of which some are given."""
    numbers = ("offset", "unit", "variance", "noise")
    sound = {
        "axes": as_json(HOPPER.as_dict()),
        "smoothness": 1.5,
        "periodic": True,
        "length_scales": np.ones((3, 2)),
        "table": np.zeros((4, 4, 3)),
        **dict.fromkeys(numbers, np.ones(3)),
    }
    return sound | given


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("smoothness", 0.7, "smoothness 0.7"),
        ("noise", np.array([1.0, np.nan, 1.0]), "noise is not finite"),
        ("unit", np.array([1.0, 0.0, 1.0]), "unit is not above zero"),
        ("points", np.zeros((MOST_POINTS + 1, 2)), "points, where 1 to"),
        ("outputs", np.zeros((3, 2)), "outputs: expected"),
        ("offset", np.array(["a", "b", "c"]), "no numbers"),
        ("table", np.zeros((4, 3, 3)), r"table: expected \(A, S, 3\)"),
        ("table", np.full((4, 4, 3), np.inf), "table is not finite"),
        ("axes", as_json({"periodic": [], "linear": []}), "'inputs'"),
        ("axes", as_json([1, 2]), "list indices"),
        ("axes", np.arange(5, dtype=np.uint8), "Expecting value"),
        ("axes", as_json(WALKER.as_dict()), "points: expected"),
    ],
)
def test_numbers_that_no_process_has_are_refused(tmp_path, name, value, said):
    n = MOST_POINTS + 1 if name == "points" else 4
    sound = arrays(points=np.zeros((n, 2)), outputs=np.zeros((n, 3)))
    path = tmp_path / "model.npz"
    if name != "points":
        np.savez(path, **sound)
        assert load_process(path).smoothness == 1.5
    np.savez(path, **sound | {name: value})
    with pytest.raises(RecordingError, match=said):
        load_process(path)


@pytest.mark.parametrize("kind", [">f8", "<f4", "i2"])
def test_numbers_of_other_kinds_become_float64(tmp_path, kind):
    points = np.arange(8.0).reshape(4, 2).astype(kind)
    of_kind = arrays(points=points, outputs=np.ones((4, 3), kind))
    np.savez(tmp_path / "model.npz", **of_kind)
    found = load_process(tmp_path / "model.npz").points
    assert found.dtype == np.float64
    np.testing.assert_array_equal(found, np.arange(8.0).reshape(4, 2))


def test_a_process_says_in_a_line_what_it_predicts_from_what():
    options = replace(RECOMMENDED, restarts=0, own_scales=False)
    process = trained_process(HOPS, options)
    said = "<FrameChangeProcess: dx, dy, dtheta from boom_angle, swing; 60 points>"
    assert repr(process) == said
