"""Two, four and six feet, at 50 to 2000 Hz, whichever axis points up: as the truth has it."""

from dataclasses import replace

import numpy as np
import pytest

from hopdata.landings.floor import fit_floor, level
from hopdata.landings.pair_assembly import assemble_pairs
from hopdata.landings.sections import select_sections
from hopdata.landings.touchdowns import touchdown_table
from hopdata.maps.truth.matching import match_landings
from hopdata.recordings.axes import rotate_up
from hopdata.recordings.hdf5 import write_recording
from hopdata.recordings.importing import import_recording
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis import simulate_recording

THREE = HopperParameters()
BODY = [f"body{k + 1}" for k in range(8)]


def simulate(feet, *, hops=40, rate_hz=100.0, markers=3, seed=8):
    """Simulate legs that together do what three do; a biped is dropped for every landing."""
    share = 3 / feet
    hopper = {
        name: share * getattr(THREE, name)
        for name in ("stiffness_n_m", "damping_n_s_m", "preload_n")
    }
    simulation = {"hops": hops, "hopper": {"n_legs": feet, **hopper}}
    if feet == 2:
        simulation["operator"] = {"arena_m": 1e-6, "carry_s": 0.5}
    angle = 2 * np.pi * np.arange(markers) / markers
    heights = 0.06 + 0.02 * np.cos(2 * angle)
    body = np.column_stack([0.14 * np.cos(angle), 0.14 * np.sin(angle), heights])
    camera = {"rate_hz": rate_hz, "markers": {"body_m": body.tolist()}}
    return simulate_recording(simulation, camera, seed=seed)


def touchdowns(recording):
    """Levelled recording, sections and table of touchdowns."""
    flat = level(recording, fit_floor(recording))
    sections = select_sections([flat])
    heights = {
        "pre_height_m": sections.pre_height_m,
        "post_height_m": sections.post_height_m,
    }
    return flat, heights, touchdown_table(flat, **heights)


def contacts(table):
    return table.filter(regex="^contact_.*_s$").to_numpy()


def errors_and_gaps(table, truth):
    """Errors of the used instants, s, and whether each order is right, with its closest pair, s."""
    used = table[~table["excluded"]]
    landing = match_landings(contacts(used), truth.contact_times)
    assert (landing >= 0).all(), "a touchdown that never was"
    true = truth.contact_times[landing]
    right = (np.argsort(contacts(used), axis=1) == np.argsort(true, axis=1)).all(axis=1)
    return contacts(used) - true, right, np.diff(np.sort(true, axis=1)).min(axis=1)


@pytest.mark.parametrize(
    ("feet", "rate_hz", "rms_ms"),
    [(2, 100, 0.5), (4, 500, 0.3), (6, 100, 0.6), (6, 50, 1.0), (2, 2000, 0.2)],
)
def test_instants_and_orders_are_those_of_the_truth(feet, rate_hz, rms_ms):
    hops = 40 if rate_hz <= 100 else 15
    recording, truth = simulate(feet, hops=hops, rate_hz=rate_hz)
    _, _, table = touchdowns(recording)
    assert (~table["excluded"]).sum() >= 0.8 * hops
    assert table.loc[table["excluded"], "reason"].ne("").all()
    error, right, closest = errors_and_gaps(table, truth)
    assert 1e3 * (error - error.mean()).std() < rms_ms
    assert right[closest > 4e-3 * rms_ms].all(), "contacts further apart than four errors"
    schedules = table.loc[~table["excluded"], "schedule"]
    assert schedules.str.count(">").eq(feet - 1).all()
    assert schedules.map(lambda name: sorted(name.split(">"))).str.len().eq(feet).all()


@pytest.fixture(scope="module")
def many_markers():
    return simulate(6, hops=15, markers=8)[0]


@pytest.mark.parametrize("markers", [3, 5, 8])
def test_any_number_of_body_markers_gives_states(many_markers, markers):
    kept = [
        k
        for k, name in enumerate(many_markers.markers)
        if name not in BODY or name in BODY[:markers]
    ]
    fewer = replace(
        many_markers,
        positions=many_markers.positions[:, kept],
        markers=tuple(many_markers.markers[k] for k in kept),
        roles=tuple(many_markers.roles[k] for k in kept),
    )
    flat, heights, table = touchdowns(fewer)
    pairs = assemble_pairs([flat], table, home_marker="body1", **heights)
    assert pairs.x.shape[1] == pairs.y.shape[1] == 6 * markers
    assert len(pairs.x) >= 10
    assert np.isfinite(pairs.x).all()


@pytest.mark.parametrize("axis", ["x", "y", "-x", "-y", "-z"])
def test_the_vertical_axis_of_the_file_changes_nothing(axis, tmp_path):
    recording, _ = simulate(2, hops=15)
    turn = rotate_up(np.eye(3), axis)  # rows: where the file's axes go
    markers = {"body": recording.names("body"), "feet": recording.names("foot")}
    tables = {}
    for name, file in {
        "z": recording,
        axis: replace(recording, positions=np.ascontiguousarray(recording.positions @ turn.T)),
    }.items():
        write_recording(tmp_path / f"{name}.h5", file, None)
        read, _ = import_recording(
            tmp_path / f"{name}.h5", name="one", markers=markers, vertical_axis=name
        )
        tables[name] = touchdowns(read)[2]
    assert len(tables["z"]) >= 14
    assert tables["z"].equals(tables[axis])


def test_a_gap_of_a_few_milliseconds_at_a_section_costs_no_landing():
    recording, _ = simulate(4, hops=8, rate_hz=1000)
    flat, heights, table = touchdowns(recording)
    first = table[~table["excluded"]].iloc[0]
    hidden, lost = flat.positions.copy(), flat.positions.copy()
    at = np.searchsorted(flat.time, first["t_pre_s"])
    hidden[at - 3 : at + 3, flat.indices("body")] = np.nan  # 7 ms from frame to frame
    lost[at - 20 : at + 20, flat.indices("body")] = np.nan  # 41 ms
    again = touchdown_table(replace(flat, positions=hidden), **heights)
    assert again["excluded"].equals(table["excluded"])
    assert abs(again["t_pre_s"] - table["t_pre_s"]).max() < 1e-3
    refused = touchdown_table(replace(flat, positions=lost), **heights)
    assert refused["reason"][first["index"]] == "frames missing at the pre section"
