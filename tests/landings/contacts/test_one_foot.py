"""Markers of one shoe are told from feet, however these move."""

from dataclasses import replace

import numpy as np
import pytest

import hopdata as hd
from hopdata.landings.contacts.one_foot import markers_of_one_foot, one_foot_remarks
from hopdata.messages import in_shell

SHOE = np.array([[0.0, 0.0, 0.03], [0.2, 0.03, 0.02], [0.2, -0.06, 0.02]])
TRIANGLE = 0.38 * np.array([[1.0, 0.0, 0.0], [-0.5, 0.87, 0.0], [-0.5, -0.87, 0.0]])
NAMES = ["heel", "mt1", "mt5"]


def pitched(shape, pitch):
    """Return points (K, 3) turned about y by angles (N,), (N, K, 3)."""
    x, y, z = shape.T
    forward = np.outer(np.cos(pitch), x) + np.outer(np.sin(pitch), z)
    upward = np.outer(np.cos(pitch), z) - np.outer(np.sin(pitch), x)
    return np.stack([forward, np.broadcast_to(y, forward.shape), upward], axis=2)


def recording(
    shape, *, pitch_rad, bend_m=0.0, noise_m=0.0005, body=True, with_trunk=False, n=2000
):
    """Return three markers that swing in pitch, and each by itself along its leg.

    The trunk stays upright, or turns with them.
    """
    above = np.array([[0.0, 0.1, 0.9], [0.1, -0.1, 1.0], [-0.1, 0.0, 1.4]])
    rng = np.random.default_rng(3)
    time = np.arange(n) / 200
    pitch = pitch_rad * np.sin(2 * np.pi * 1.3 * time)
    turned = pitched(shape, pitch)
    turned[:, :, 2] += bend_m * rng.standard_normal((n, 3))
    turned[:, :, 2] += 0.2 * np.abs(np.sin(6 * time))[:, None]
    trunk = pitched(above, pitch if with_trunk else 0 * pitch)
    trunk = trunk + 0.01 * np.sin(6 * time)[:, None, None]
    positions = np.concatenate([turned, trunk], axis=1)
    positions = positions + noise_m * rng.standard_normal(positions.shape)
    of_body = ["hip1", "hip2", "hip3"]
    roles = {"feet": NAMES, "body": of_body if body else ()}
    return hd.Recording.from_arrays(time, positions, NAMES + of_body, **roles)


@pytest.mark.parametrize("body", [True, False])
def test_a_shoe_that_swings_is_one_foot(body):
    shoe = recording(SHOE, pitch_rad=0.5, body=body)
    assert markers_of_one_foot(shoe) == [tuple(NAMES)]
    (remark,) = one_foot_remarks(shoe)
    assert "heel, mt1 and mt5 keep their distances" in str(remark)
    assert "feet={'foot': ['heel', 'mt1', 'mt5']}" in str(remark)
    assert "--feet" not in str(remark)
    typed = str(in_shell(remark))
    assert typed.endswith("then name them as one: --feet 'foot=heel,mt1,mt5'")
    as_one = shoe.with_roles(feet={"foot": NAMES})
    assert one_foot_remarks(as_one) == []


@pytest.mark.parametrize(
    ("shape", "how"),
    [
        (TRIANGLE, {"pitch_rad": 0.1}),  # legs of a hopper, at constant distances
        (TRIANGLE, {"pitch_rad": 0.6, "with_trunk": True}),  # one that falls over
        (SHOE, {"pitch_rad": 0.5, "bend_m": 0.03}),  # three feet close together
        (SHOE, {"pitch_rad": 0.0}),  # a shoe that never tilts comes down as one
    ],
)
def test_feet_are_not(shape, how):
    assert markers_of_one_foot(recording(shape, **how)) == []


@pytest.mark.parametrize("scene", ["hopper", "quadruped"])
def test_feet_of_a_simulated_animal_are_not(scene):
    simulated, _ = hd.synthesize(scene, simulation={"hops": 8}, seed=2)
    assert markers_of_one_foot(simulated) == []


def test_stiff_legs_that_fall_over_are_not():
    # Rigid but for 2 mm, they tilt by more than a shoe: only the body tells them.
    stiff = {"stiffness_n_m": 900.0, "damping_n_s_m": 15.0, "preload_n": 220.0}
    fallen, _ = hd.synthesize(
        "hopper", simulation={"hops": 20, "hopper": stiff}, seed=11
    )
    assert markers_of_one_foot(fallen) == []
    feet = list(fallen.names("foot"))
    assert markers_of_one_foot(fallen[feet]) == [tuple(feet)]


def test_markers_that_are_never_seen_together_do_not_stop_it():
    shoe = recording(SHOE, pitch_rad=0.5)
    seen = shoe.positions.copy()
    half = len(seen) // 2
    seen[:half, NAMES.index("heel")] = np.nan
    seen[half:, NAMES.index("mt5")] = np.nan
    assert markers_of_one_foot(replace(shoe, positions=seen)) == [tuple(NAMES)]


def test_the_sample_has_three_feet(sample_path):
    assert markers_of_one_foot(hd.read(sample_path)) == []


def test_shoes_of_a_runner_are_told_apart(external_recording):
    feet = ["R_heel", "L_mt5", "R_mt1", "R_mt5", "L_heel", "L_mt1"]
    runner = hd.read(external_recording).with_roles(feet=feet)
    found = {frozenset(one) for one in markers_of_one_foot(runner)}
    assert found == {
        frozenset(("R_heel", "R_mt1", "R_mt5")),
        frozenset(("L_heel", "L_mt1", "L_mt5")),
    }
    assert markers_of_one_foot(runner.with_roles(feet=["R_heel", "L_heel"])) == []
    named = one_foot_remarks(runner[["R_heel", "R_mt1"]])
    assert "feet={'right': ['R_heel', 'R_mt1']}" in str(named[0])


def test_contacts_say_so_once(external_recording):
    runner = hd.read(external_recording).between(0, 4)
    remarks = hd.contacts(runner, feet=["R_heel", "R_mt1", "R_mt5"]).messages
    codes = [one.code for one in remarks]
    assert codes.count("landings.markers_of_one_foot") == 1
    right = {"right": ["R_heel", "R_mt1", "R_mt5"]}
    found = hd.contacts(runner, feet=right)
    assert "landings.markers_of_one_foot" not in [one.code for one in found.messages]


@pytest.mark.filterwarnings("error")
def test_two_names_of_one_marker_are_no_fault():
    shoe = recording(np.array([SHOE[0], SHOE[0], SHOE[1]]), pitch_rad=0.6, noise_m=0.0)
    assert markers_of_one_foot(shoe) == [("heel", "mt1", "mt5")]
