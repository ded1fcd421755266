"""The scaling study on made-up maps with known derivatives."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from hopdata.maps.truth.scaling import scaling_table, score_scaling
from hopdata.maps.truth.scoring import score_states, state_errors, true_rows

SCALES = (1.0, 0.5, 0.25, 0.125)
MATRIX = np.random.default_rng(1).normal(size=(11, 8))
KINK = np.random.default_rng(2).normal(size=11)
PUSH = np.random.default_rng(3).normal(size=(11, 3))


def landings(case, scale, *, kink=0.0, bend=0.1, push=1.0, count=600):
    """Return outcomes of a map with a kink across x[0] = 0, a bend, and an effect of preloads."""
    rng = np.random.default_rng(7)
    x = scale * rng.normal(size=(count, 8))
    preloads = scale * rng.normal(size=(count, 3))
    y = x @ MATRIX.T + push * preloads @ PUSH.T
    y += kink * np.abs(x[:, :1]) * KINK + bend * x[:, 1:2] ** 2 * KINK[::-1]
    first = x[:, 0] > 0
    exact = np.array(
        [MATRIX + sign * kink * np.outer(KINK, np.eye(8)[0]) for sign in (1, -1)]
    )
    return SimpleNamespace(
        case=case,
        control=SimpleNamespace(coupling=kink, impulse=0.0, delay_s=0.0),
        scale=scale,
        x=x,
        y=y,
        preloads_n=preloads,
        contact_s=0.01 * scale * rng.normal(size=(count, 3)),
        schedule=np.where(first, "1>2", "2>1"),
        n_failed=3,
        exact_maps=exact,
    )


def table(case="hopper", **how):
    return scaling_table(landings(case, scale, **how) for scale in SCALES)


def test_the_error_of_a_smooth_map_falls_with_the_square_of_the_scale():
    found = table()
    np.testing.assert_allclose(found["slope"], 2.0, atol=0.01)
    np.testing.assert_allclose(found["pooled_over_specialised"], 1.0, atol=0.1)
    assert found["map_difference"].iloc[-1] < 0.3 * found["map_difference"].iloc[0]
    assert (found["exact_difference"] == 0).all()
    assert found["map_error"].iloc[-1] < 0.01
    assert found[["landings", "failed", "schedules"]].iloc[0].tolist() == [600, 3, 2]
    np.testing.assert_allclose(
        found["spread_ms"] / found["scale"], found["spread_ms"].iloc[0]
    )


def test_the_error_of_a_kinked_map_falls_with_the_scale_and_its_maps_stay_apart():
    found = table("coupling", kink=0.2, bend=0.005)
    np.testing.assert_allclose(found["slope"], 1.0, atol=0.05)
    assert found["pooled_over_specialised"].iloc[-1] > 20
    last = found.iloc[-1]
    assert last["map_difference"] == pytest.approx(last["exact_difference"], rel=0.05)


def test_preloads_are_no_noise_here():
    one, other = table(push=1.0), table(push=0.0)
    size = one["pooled_rms"] / other["pooled_rms"]
    np.testing.assert_allclose(size, size.iloc[0], rtol=1e-6)
    np.testing.assert_allclose(one["slope"], other["slope"], rtol=1e-6)


def test_a_schedule_with_too_few_landings_has_no_map():
    found = table(count=16)
    assert found["schedules"].max() < 2
    assert found["pooled_rms"].notna().all()


def test_a_case_without_landings_has_a_row_without_errors():
    import pandas as pd

    nothing = landings("delay", 1.0, count=0)
    found = scaling_table([nothing, *(landings("hopper", scale) for scale in SCALES)])
    row = found.iloc[0]
    assert (row["case"], row["landings"], row["failed"]) == ("delay", 0, 3)
    assert pd.isna(row["pooled_rms"])
    entries = score_scaling(found)
    assert entries["scaling_slope_delay"]["value"] is None
    assert entries["scaling_slope_hopper"]["value"] == pytest.approx(2, abs=0.01)


def test_the_entries_name_case_strength_and_scale():
    import pandas as pd

    found = pd.concat([table(), table("coupling", kink=0.2)])
    entries = score_scaling(found)
    assert entries["scaling_slope_hopper"]["value"] == pytest.approx(2, abs=0.01)
    assert "coupled forces (kappa 0.2)" in entries["scaling_slope_coupling"]["what"]
    assert "at 0.125 of the spread" in entries["scaling_map_difference_hopper"]["what"]
    assert entries["exact_map_difference_coupling"]["value"] > 0.01


# Errors of states and maps on made-up rigid bodies whose maps are known.

POINTS = np.array([(0.13, 0.03, 0.05), (-0.08, 0.11, 0.075), (-0.07, -0.14, 0.055)])
ARMS = POINTS - POINTS.mean(axis=0)
FEET = ("a", "b", "c")
COUNT = 700
MAP = np.random.default_rng(1).normal(size=(11, 8))
MAP[3:5] *= 0.05


def rotations(yaw, pitch, roll):
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("ZYX", np.column_stack([yaw, pitch, roll])).as_matrix()


def markers(centre, angles, velocity, spin):
    """Return marker states (n, 18) of a rigid body; the centre's velocity is in the world."""
    turn = rotations(*angles.T)
    place = centre[:, None] + np.einsum("nij,bj->nbi", turn, ARMS)
    moving = np.cross(spin[:, None], ARMS[None])
    speed = velocity[:, None] + np.einsum("nij,nbj->nbi", turn, moving)
    return np.hstack([place.reshape(len(turn), -1), speed.reshape(len(turn), -1)])


def study(kink=0.0):
    """Return true pairs whose outcome is linear in the inputs on either side of x[0] = 0."""
    rng = np.random.default_rng(5)
    x = 0.05 * rng.normal(size=(COUNT, 8))
    yaw = rng.uniform(-3, 3, COUNT)
    place = np.column_stack([rng.uniform(-1, 1, (COUNT, 2)), np.full(COUNT, 0.5)])
    first = x[:, 0] > 0
    maps = np.array([MAP, MAP.copy()])
    maps[0, :, 0] += kink
    maps[1, :, 0] -= kink
    y = np.einsum("nqp,np->nq", maps[np.where(first, 0, 1)], x)
    heading = rotations(yaw, 0 * yaw, 0 * yaw)

    def in_world(vectors):
        return np.einsum("nij,nj->ni", heading, vectors)

    pre = markers(
        place, np.column_stack([yaw, x[:, :2]]), in_world(x[:, 2:5]), x[:, 5:]
    )
    step = in_world(np.column_stack([y[:, :2], np.full(COUNT, -0.2)]))
    angles = np.column_stack([yaw + y[:, 2], y[:, 3:5]])
    post = markers(place + step, angles, in_world(y[:, 5:8]), y[:, 8:])
    true = SimpleNamespace(
        x=pre,
        y=post,
        schedule=np.where(first, "1>2>3", "3>2>1"),
        recording=np.full(COUNT, "one"),
        touchdown=np.arange(COUNT) + 1,
    )
    exact = {
        "body_points_m": POINTS.tolist(),
        "maps": maps,
        "schedules": ["1>2>3", "3>2>1"],
    }
    return true, exact


def homed(states, turn, shift):
    """Return marker states in another frame of the plane, (n, 18)."""
    parts = states.reshape(len(states), 6, 3) @ turn
    parts[:, :3, :2] += shift
    return parts.reshape(len(states), -1)


def measured(true, noise=0.0):
    rng = np.random.default_rng(8)
    turn = rotations(np.array([0.6]), np.zeros(1), np.zeros(1))[0]
    x, y = (homed(states, turn, [0.3, -2.0]) for states in (true.x, true.y))
    x, y = (states + noise * rng.normal(size=states.shape) for states in (x, y))
    return SimpleNamespace(
        x=x, y=y, recording=true.recording, touchdown=true.touchdown + 5
    )


def test_states_in_another_frame_have_no_error_and_noise_has_its_own():
    true, _ = study()
    rows = np.arange(COUNT)
    exactly = state_errors(measured(true), true, rows)
    assert exactly["section"].tolist() == ["pre", "post"]
    assert exactly[["position_rms_mm", "velocity_rms_mm_s"]].to_numpy().max() < 1e-9
    noisy = state_errors(measured(true, 0.001), true, rows)
    np.testing.assert_allclose(noisy["velocity_rms_mm_s"], 1.0, rtol=0.02)
    np.testing.assert_allclose(noisy["position_rms_mm"], np.sqrt(15 / 18), rtol=0.02)


def test_touchdowns_find_their_true_landing_by_time():
    true, _ = study()
    kept = np.arange(COUNT) != 7
    true = SimpleNamespace(**{name: value[kept] for name, value in vars(true).items()})
    instants = np.arange(COUNT)[:, None] * 0.6 + [0.0, 0.01, 0.02]
    pairs = SimpleNamespace(
        recording=np.full(4, "one"), touchdown=np.array([9, 2, 4, 3])
    )
    table = pd.DataFrame(
        {"recording": "one", "touchdown": [2, 3, 4, 9], "excluded": False}
    )
    table[[f"contact_{foot}_s" for foot in FEET]] = instants[[11, 7, 20, 3]] + 0.004
    table.loc[2, "contact_a_s"] += 3000.0
    rows = true_rows(pairs, table, true, {"one": instants}, FEET)
    assert rows.tolist() == [3, 10, -1, -1]


def test_the_entries_name_the_section():
    true, _ = study()
    entries = score_states(state_errors(measured(true, 0.001), true, np.arange(COUNT)))
    assert entries["velocity_rms_post"]["value"] == pytest.approx(1.0, rel=0.05)
