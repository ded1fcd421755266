"""Markers of one shoe are told from feet, however these move."""

import numpy as np
import pytest

import hopdata as hd
from hopdata.landings.contacts.one_foot import markers_of_one_foot, one_foot_remarks

SHOE = np.array([[0.0, 0.0, 0.03], [0.2, 0.03, 0.02], [0.2, -0.06, 0.02]])
TRIANGLE = 0.38 * np.array([[1.0, 0.0, 0.0], [-0.5, 0.87, 0.0], [-0.5, -0.87, 0.0]])
NAMES = ["heel", "mt1", "mt5"]


def recording(shape, *, pitch_rad, bend_m=0.0, noise_m=0.0005, body=True, n=2000):
    """Return three markers that swing in pitch, and each by itself along its leg."""
    rng = np.random.default_rng(3)
    time = np.arange(n) / 200
    pitch = pitch_rad * np.sin(2 * np.pi * 1.3 * time)
    turned = np.stack([
        np.outer(np.cos(pitch), shape[:, 0]) + np.outer(np.sin(pitch), shape[:, 2]),
        np.broadcast_to(shape[:, 1], (n, 3)),
        np.outer(np.cos(pitch), shape[:, 2]) - np.outer(np.sin(pitch), shape[:, 0]),
    ], axis=2)  # fmt: skip
    turned[:, :, 2] += bend_m * rng.standard_normal((n, 3))
    turned[:, :, 2] += 0.2 * np.abs(np.sin(6 * time))[:, None]
    above = np.array([[0.0, 0.1, 0.9], [0.1, -0.1, 1.0], [-0.1, 0.0, 1.4]])
    trunk = np.broadcast_to(above, (n, 3, 3)) + 0.01 * np.sin(6 * time)[:, None, None]
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
    assert "--feet 'foot=heel,mt1,mt5'" in str(remark)
    as_one = shoe.with_roles(feet={"foot": NAMES})
    assert one_foot_remarks(as_one) == []


@pytest.mark.parametrize(
    ("shape", "how"),
    [
        (TRIANGLE, {"pitch_rad": 0.1}),  # legs of a hopper, at constant distances
        (TRIANGLE, {"pitch_rad": 0.6}),  # one that all but falls over
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
    remarks = hd.contacts(runner, feet=["R_heel", "R_mt1", "R_mt5"]).remarks
    codes = [one.code for one in remarks]
    assert codes.count("landings.markers_of_one_foot") == 1
    right = {"right": ["R_heel", "R_mt1", "R_mt5"]}
    found = hd.contacts(runner, feet=right)
    assert "landings.markers_of_one_foot" not in [one.code for one in found.remarks]
