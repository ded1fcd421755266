"""Processes: agreement with scikit-learn, gradients, periodicity."""

from dataclasses import fields, replace

import numpy as np
import pytest
from frame_change_models import change_and_gradient, correlation_slope, regressor_of
from steered_hops import LIMIT, chained_hops, smooth_change

from hopdata.errors import AnalysisError, ConfigError, RecordingError
from hopdata.steering.models.process import (
    MOST_INPUTS,
    PRINTED,
    RECOMMENDED,
    SMOOTHNESSES,
    FrameChangeProcess,
    ProcessOptions,
    correlation,
    embedded,
    fitted_regressor,
    hyper_parameters,
    input_units,
    load_process,
    save_process,
    trained_process,
    training_set,
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


def test_mean_and_sd_are_those_of_scikit_learn(trained):
    _, process, points = trained
    mean, sd = process.change(*points.T), process.sd(*points.T, observed=True)
    asked = embedded(points, process.periodic)
    for j in range(3):
        peer = regressor_of(process, j)
        found, spread = peer.predict(asked, return_std=True)
        found = found * process.unit[j] + process.offset[j]
        np.testing.assert_allclose(found, mean[:, j], atol=1e-10)
        np.testing.assert_allclose(spread * process.unit[j], sd[:, j], atol=1e-10)


def test_hyper_parameters_are_those_that_scikit_learn_found(trained):
    options, process, _ = trained
    targets = (process.outputs - process.offset) / process.unit
    once = len(process.inputs) // (1 if options.periodic else 3)  # without the copies
    scale = input_units(process.inputs[:once], options)
    peer = fitted_regressor(process.inputs / scale, targets[:, 1], options, 0)
    assert hyper_parameters(peer)[2] == process.noise[1]


def test_gradients_are_those_of_differences(trained):
    _, process, points = trained
    gradient = change_and_gradient(process, *points.T)[1]
    for axis in range(points.shape[1]):
        step = np.zeros(points.shape[1])
        step[axis] = (
            # Shorter steps show rounding, because repeated hops have large weights
            1e-4
        )
        ahead, behind = process.mean_at(points + step), process.mean_at(points - step)
        np.testing.assert_allclose(
            gradient[:, :, axis], (ahead - behind) / 2e-4, atol=1e-6
        )


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
    assert len(process.inputs) == 3 * len(HOPS)
    assert process.inputs[:, 0].min() < -np.pi < 3 * np.pi < process.inputs[:, 0].max()
    assert np.all(process.variance == 1)
    assert np.all(process.noise == 0.1)
    assert np.all(process.length_scales == 1)
    # Matern kernel of smoothness 3/2 by the formula with its Bessel function.
    from scipy.special import gamma, kv

    distance = np.array([0.3, 1.0, 2.0])
    root = np.sqrt(3) * distance
    printed = root**1.5 * kv(1.5, root) / (gamma(1.5) * np.sqrt(2))
    np.testing.assert_allclose(correlation(distance**2, 1.5), printed, rtol=1e-12)


@pytest.mark.parametrize("smoothness", SMOOTHNESSES)
def test_slopes_of_kernels_are_those_of_differences(smoothness):
    for s in (0.01, 0.7, 3.0):
        step = 1e-6 * s
        ahead, behind = correlation(np.array([s + step, s - step]), smoothness)
        slope = correlation_slope(np.array([s]), smoothness)[0]
        assert slope == pytest.approx((ahead - behind) / (2 * step), rel=1e-6)


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
    assert change_and_gradient(process, np.zeros(0), np.zeros(0))[1].shape == (0, 3, 2)


def test_hops_alike_without_noise_are_an_error():
    one = trained_process(HOPS)
    twice = replace(one, inputs=np.tile(one.inputs[:1], (60, 1)), noise=np.zeros(3))
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


def test_the_limit_of_the_test_hops_is_the_robot_s():
    assert pytest.approx(3 * np.pi / 8) == LIMIT


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("smoothness", 0.7, "smoothness 0.7"),
        ("noise", np.array([1.0, np.nan, 1.0]), "noise is not finite"),
        ("unit", np.array([1.0, 0.0, 1.0]), "unit is not above zero"),
        ("inputs", np.zeros((MOST_INPUTS + 1, 2)), "inputs, where 1 to"),
        ("outputs", np.zeros((3, 2)), "outputs: expected"),
        ("offset", np.array(["a", "b", "c"]), "no numbers"),
    ],
)
def test_numbers_that_no_process_has_are_refused(tmp_path, name, value, said):
    sound = {
        "smoothness": 1.5,
        "periodic": True,
        "inputs": np.zeros((MOST_INPUTS + 1 if name == "inputs" else 4, 2)),
        "outputs": np.zeros((MOST_INPUTS + 1 if name == "inputs" else 4, 3)),
        "length_scales": np.ones((3, 2)),
        **dict.fromkeys(("offset", "unit", "variance", "noise"), np.ones(3)),
    }
    path = tmp_path / "model.npz"
    if name != "inputs":
        np.savez(path, **sound)
        assert load_process(path).smoothness == 1.5
    np.savez(path, **sound | {name: value})
    with pytest.raises(RecordingError, match=said):
        load_process(path)


@pytest.mark.parametrize("kind", [">f8", "<f4", "i2"])
def test_numbers_of_other_kinds_become_float64(tmp_path, kind):
    arrays = {
        "smoothness": 1.5,
        "periodic": True,
        "inputs": np.arange(8.0).reshape(4, 2).astype(kind),
        "outputs": np.ones((4, 3), kind),
        "length_scales": np.ones((3, 2)),
        **dict.fromkeys(("offset", "unit", "variance", "noise"), np.ones(3)),
    }
    np.savez(tmp_path / "model.npz", **arrays)
    inputs = load_process(tmp_path / "model.npz").inputs
    assert inputs.dtype == np.float64
    np.testing.assert_array_equal(inputs, np.arange(8.0).reshape(4, 2))
