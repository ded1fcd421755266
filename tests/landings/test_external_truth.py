"""Force plates and events of a recording's own file, compared without configuration."""

from dataclasses import replace

import numpy as np
import pytest
from external_blocks import block
from synthetic_landings import FOOT_RADIUS, POST_HEIGHT_M, PRE_HEIGHT_M, simulate
from written_files import Analog, write_c3d

from hopdata.config.consistency import external_blocks
from hopdata.figures.overlay import contact_overlay_figure
from hopdata.jobs import read_table, write_table
from hopdata.landings.external_truth import overlay_external_truth
from hopdata.landings.touchdowns import touchdown_table
from hopdata.recording import Event
from hopdata.recordings.raw import RawRecording
from hopdata.report.tables import agreement_table

FEET = ("foot1", "foot2", "foot3")
PER_FRAME = 10
NOISE_N = 0.3
SECTIONS = {"pre_height_m": PRE_HEIGHT_M, "post_height_m": POST_HEIGHT_M}


@pytest.fixture(scope="module")
def scene():
    return simulate(40, seed=33)


@pytest.fixture(scope="module")
def touchdowns(scene):
    return touchdown_table(scene.recording, **SECTIONS)


def corners_about(x_mm, y_mm, half_mm):
    """Return the corners of a plate whose z points down."""
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [1, -1]
    flat = half_mm * signs + np.array([x_mm, y_mm])
    return np.column_stack([flat, np.zeros(4)])


def write_scene(path, scene, corners, feet_of_plates, **given):
    """Write a scene with plates; each shows the load of some feet, with its axes down."""
    recording = scene.recording
    time = np.arange(len(recording.time) * PER_FRAME) / (recording.rate_hz * PER_FRAME)
    shown = []
    for number, feet in enumerate(feet_of_plates):
        load = np.random.default_rng(number).normal(0, NOISE_N, len(time))
        for onset in scene.contact_times[:, feet].ravel():
            on = (time >= onset) & (time < onset + 0.15)
            load[on] += np.minimum(8000 * (time[on] - onset), 80)
        plate = np.zeros((len(time), 6))
        plate[:, 2] = -load  # the force on the subject, along an axis into the floor
        shown.append(plate)
    values = np.hstack(shown)
    n = values.shape[1]
    group = {
        "USED": len(corners),
        "TYPE": np.full(len(corners), 2),
        "CORNERS": np.array(corners),
        "ORIGIN": np.tile([0.0, 0.0, -30.0], (len(corners), 1)),
        "CHANNEL": np.arange(1, n + 1).reshape(len(corners), 6),
    }
    analog = Analog(
        [f"c{k}" for k in range(n)],
        ["N", "N", "N", "Nmm", "Nmm", "Nmm"] * len(corners),
        values.reshape(len(recording.time), PER_FRAME, n),
        np.full(n, 0.01),
        np.zeros(n),
        groups={"FORCE_PLATFORM": group},
    )
    positions = 1000 * recording.positions
    raw = RawRecording(
        recording.markers, recording.time, positions, recording.rate_hz, "mm", **given
    )
    write_c3d(path, raw, analog=analog)
    return path


def configured(path, **blocks):
    own = {"file": str(path)}
    return {"contacts": block("contacts"), "forces": block("forces"), "own": own} | (
        blocks
    )


def compared(scene, touchdowns, blocks, recording=None):
    recording = recording or scene.recording
    return overlay_external_truth(
        [recording], touchdowns, {recording.name: blocks}, window_s=0.05
    )


def each_foot_at(scene, middles_m):
    """Return the scene with each foot above a place of its own in all landings."""
    positions = scene.recording.positions.copy()
    for marker, middle in zip(scene.recording.indices("foot"), middles_m, strict=True):
        positions[:, marker, :2] = middle
    return replace(scene, recording=replace(scene.recording, positions=positions))


def test_a_plate_under_each_foot(scene, touchdowns, tmp_path):
    angle = 2 * np.pi * np.arange(3) / 3
    middles = 1000 * FOOT_RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])
    corners = [corners_about(*middle, 120) for middle in middles]
    scene = each_foot_at(scene, 1e-3 * middles)
    path = write_scene(tmp_path / "a.c3d", scene, corners, [[0], [1], [2]])
    found = compared(scene, touchdowns, configured(path))
    assert list(found.summary["column"]) == ["plate 1", "plate 2", "plate 3"]
    assert list(found.summary["feet"]) == list(FEET)
    assert set(found.summary["source"]) == {"plates"}
    assert (found.summary["n_matched"] >= 38).all()
    assert (found.summary["n_missed"] + found.summary["n_invented"] <= 2).all()
    # Neither device is late, and both state what they are worth.
    assert found.summary["bias_s"].abs().max() < 5e-4
    assert found.summary["external_se_s"].between(1e-4, 1e-3).all()
    # These rises are all straight, so what is stated for their shape is no scatter.
    assert (found.summary["scatter_over_se"] < 1.2).all()
    own = found.contacts.groupby("column")["se_s"].median().to_numpy()
    assert (found.summary["robust_sd_s"] > 0.6 * own).all()
    shown = set(found.example["kind"])
    assert shown == {"height", "force", "threshold", "external", "found"}
    assert found.notes.empty
    assert found.thresholds.empty


def test_one_plate_under_all_feet_gives_their_first_contact(
    scene, touchdowns, tmp_path
):
    path = write_scene(
        tmp_path / "a.c3d", scene, [corners_about(0, 0, 600)], [[0, 1, 2]]
    )
    found = compared(scene, touchdowns, configured(path))
    (row,) = found.summary.to_dict("records")
    assert row["feet"] == "foot1 foot2 foot3"
    assert row["n_matched"] >= 38
    assert abs(row["bias_s"]) < 5e-4
    assert list(found.notes["code"]) == ["landings.plate_shared"]


def test_a_plate_that_nobody_followed_steps_on(scene, touchdowns, tmp_path):
    path = write_scene(tmp_path / "a.c3d", scene, [corners_about(3000, 0, 300)], [[0]])
    found = compared(scene, touchdowns, configured(path))
    assert found.contacts.empty
    assert found.summary.empty
    assert found.example.empty
    # The workflow passes tables on as files.
    for name in ("contacts", "summary", "example", "notes", "thresholds"):
        file = tmp_path / f"{name}.csv"
        write_table(file, getattr(found, name))
        assert len(read_table(file)) == len(getattr(found, name))
    tables = {"contact_overlay_summary": found.summary}
    assert agreement_table(tables) is None
    columns = set(compared(scene, touchdowns, configured(path)).summary)
    whole = write_scene(tmp_path / "b.c3d", scene, [corners_about(0, 0, 600)], [[0]])
    assert columns == set(compared(scene, touchdowns, configured(whole)).summary)
    contact_overlay_figure(found.contacts, found.summary, found.example)
    assert list(found.notes["code"]) == ["landings.plate_of_other_feet"]


def test_what_cannot_be_compared_is_a_note_and_no_error(scene, touchdowns, tmp_path):
    """Nobody asked for this comparison, so that it must not stop a study."""
    path = write_scene(tmp_path / "a.c3d", scene, [corners_about(0, 0, 600)], [[0]])
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    found = compared(scene, touchdowns, configured(path))
    assert list(found.notes["code"]) == ["landings.plates_not_read"]
    late = replace(scene.recording, time=scene.recording.time + 500.0)
    path.write_bytes(whole)
    later = touchdowns.assign(
        **{
            column: touchdowns[column] + 500.0
            for column in touchdowns
            if column.startswith("contact_") or column in ("t_pre_s", "t_post_s")
        }
    )
    found = compared(scene, later, configured(path), late)
    assert set(found.notes["code"]) <= {
        "landings.own_not_compared",
        "landings.plate_of_other_feet",
    }
    assert found.contacts.empty


def test_events_of_a_side_are_compared(scene, touchdowns, tmp_path):
    names = {"foot1": "L_toe", "foot2": "R_toe", "foot3": "R_heel"}
    markers = tuple(names.get(name, name) for name in scene.recording.markers)
    first_right = scene.contact_times[:, 1:].min(axis=1)
    events = [Event("Left Foot Strike", t) for t in scene.contact_times[:, 0]]
    events += [Event("Right Foot Strike", t) for t in first_right]
    recording = replace(scene.recording, markers=markers, events=tuple(events))
    table = touchdown_table(recording, **SECTIONS)
    file = tmp_path / "events.csv"
    found = compared(scene, table, configured(file), recording)
    assert list(found.summary["column"]) == ["Left Foot Strike", "Right Foot Strike"]
    assert list(found.summary["feet"]) == ["L_toe", "R_toe R_heel"]
    assert (found.summary["n_matched"] >= 38).all()
    assert found.summary["bias_s"].abs().max() < 5e-4
    # Contacts that the configuration names replace them.
    truth = tmp_path / "contacts.csv"
    np.savetxt(
        truth,
        scene.contact_times,
        delimiter=",",
        header="L_toe,R_toe,R_heel",
        comments="",
    )
    asked = configured(file, contacts=block("contacts", file=str(truth)))
    found = compared(scene, table, asked, recording)
    assert set(found.summary["source"]) == {"contacts"}


def test_which_recordings_are_compared(scene, tmp_path):
    path = write_scene(tmp_path / "a.c3d", scene, [corners_about(0, 0, 600)], [[0]])
    recording = scene.recording
    plain = RawRecording(
        recording.markers,
        recording.time,
        1000 * recording.positions,
        recording.rate_hz,
        "mm",
    )
    write_c3d(tmp_path / "plain.c3d", plain)
    marked = replace(plain, events=(Event("Left Foot Strike", 0.5),))
    write_c3d(tmp_path / "marked.c3d", marked)
    (tmp_path / "table.csv").write_text("t\n1\n")

    def entry(name, *files, **blocks):
        file = str(files[0]) if len(files) == 1 else [str(one) for one in files]
        plain_blocks = {"contacts": block("contacts"), "forces": block("forces")}
        return {"name": name, "file": file, **plain_blocks, **blocks}

    config = {
        "recordings": [
            entry("plates", path),
            entry("plain", tmp_path / "plain.c3d"),
            entry("marked", tmp_path / "marked.c3d"),
            entry("table", tmp_path / "table.csv"),
            entry("joined", path, path),
            entry(
                "asked",
                tmp_path / "table.csv",
                forces=block("forces", file="plate.txt"),
            ),
            entry("missing", tmp_path / "none.c3d"),
        ]
    }
    found = external_blocks(config)
    assert list(found) == ["plates", "marked", "asked"]
    assert found["plates"]["own"] == {"file": str(path)}
    assert found["asked"]["own"] == {"file": None}
    assert found["asked"]["forces"]["file"] == "plate.txt"
