"""The rotatable scene of the page, and the small plots beside exclusions."""

import base64
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
from fake_study import full_study

from hopdata import report
from hopdata.feet import foot_places
from hopdata.figures import style
from hopdata.recording import Recording
from hopdata.report.page import build_report
from hopdata.report.scene import UNSEEN, landings_scene, recording_scene, small_plot
from hopdata.report.tables import STATUS, excluded_table, lights, quality_summary

ROLES = {"feet": ["toe</script>", "heel"], "body": ["hip"]}
MARKERS = [*ROLES["feet"], "hip"]


def falling(frames=300):
    """Return two feet that fall in succession at 100 Hz; the second is unseen for a while."""
    time = np.arange(frames) / 100
    heights = np.stack(
        [np.abs(0.3 - time % 0.6), np.abs(0.32 - time % 0.6), 0.5 + 0 * time], axis=1
    )
    places = np.stack([0 * heights + [0, 0.2, 0.1], 0 * heights, heights], axis=2)
    places[50:60, 1] = np.nan
    return Recording.from_arrays(time, places, MARKERS, **ROLES, name="fall")


def landings(excluded=False):
    table = {
        "recording": "fall", "touchdown": [0, 1], "t_pre_s": [0.2, 0.8], "t_post_s": [0.4, np.nan],
        "contact_toe</script>_s": [0.3, 0.9], "contact_heel_s": [0.32, np.nan],
        "schedule": ["1>2", "1>2"], "spread_s": 0.02, "excluded": [excluded, True],
        "reason": ["", "foot 2 was not seen"], "order_class": "1>2", "probability": 0.99,
    }  # fmt: skip
    return pd.DataFrame(table)


def unpacked(part, key, kind):
    return np.frombuffer(base64.b64decode(part[key]), kind)


def test_a_landing_is_unpacked_to_the_tenth_of_a_millimetre():
    recording = falling()
    part = json.loads(landings_scene([recording], landings()))["parts"][0]
    time = unpacked(part, "time", "<f4")
    steps = unpacked(part, "places", "<i2").reshape(len(time), 3, 3)
    places = np.where(steps == UNSEEN, np.nan, part["middle"] + part["step"] * steps)
    first = np.searchsorted(recording.time, 0.2 + time[0] - 1e-6)
    kept = recording.positions[first : first + len(time)]
    np.testing.assert_allclose(places, kept, atol=0.6e-4)
    assert np.isnan(places).any()
    assert part["contacts"] == [0.1, 0.12]
    assert part["title"] == "toe</script> → heel: 1 landing"


def test_a_long_recording_is_shown_in_stretches_and_its_names_end_no_script():
    text = recording_scene(falling(30_001))
    assert "</script" not in text
    parts = json.loads(text)["parts"]
    assert parts[0]["markers"] == MARKERS
    times = [unpacked(part, "time", "<f4") for part in parts]
    assert [len(time) for time in times] == [2000] * 5
    assert times[0][0] == 0
    assert times[-1][-1] == 300
    assert parts[1]["title"] == "70.0 to 90.0 s"
    assert len(json.loads(recording_scene(falling(100)))["parts"]) == 1


def test_feet_have_the_colours_of_the_figures():
    """The page's script and style repeat them, and a left foot is always the first."""
    templates = Path(report.__file__).with_name("templates")
    script = (templates / "scene.js").read_text("utf-8")
    colours = re.search(r"const colours = (\[.*?\]);", script)[1]
    wanted = [colour.lower() for colour in style.FOOT_COLOURS]
    assert json.loads(colours) == wanted
    css = (templates / "report.css").read_text("utf-8")
    assert re.findall(r"\.foot\d \{ stroke: (#\w+); \}", css) == wanted
    part = json.loads(landings_scene([falling()], landings()))["parts"][0]
    assert part["looks"] == [0, 1]
    assert [*foot_places(["Right", "Left"]).values()] == [1, 0]


def test_without_landings_there_is_no_scene():
    assert landings_scene([falling()], None) == landings_scene([], landings()) == ""
    assert landings_scene([falling()], landings(excluded=True)) == ""


def test_each_excluded_landing_has_its_plot():
    table = excluded_table(landings(), [falling()])
    assert table.rows[0][1] == "heel was not seen"
    plot = table.rows[0][-1]
    assert len(re.findall("<g ", plot)) == 2
    assert plot.count('class="at"') == 1  # the other foot was not found
    assert "</script" not in plot
    assert small_plot(None, {}) == ""


def test_lights_show_the_worst_check_of_their_kind():
    checks = [
        {"what": "seen", "about": "Recordings", "status": "good", "remark": "all"},
        {"what": "noise", "about": "Recordings", "status": "poor", "remark": "5 mm"},
        {"what": "drift", "about": "Stability", "status": "good", "remark": ""},
    ]
    assert lights(checks) == [
        ("Recordings", STATUS["poor"], "noise"),
        ("Stability", STATUS["good"], "1 check"),
    ]


def test_what_nobody_asked_for_keeps_no_light_grey():
    """A study of one's own has no expected noise unless it states one."""
    seen = {"what": "seen", "about": "Recordings", "status": "good", "remark": "all"}
    noise = {
        "what": "noise",
        "about": "Recordings",
        "status": "not asked",
        "remark": "set it",
    }
    told = "1 check; not judged: noise"
    assert lights([seen, noise]) == [("Recordings", STATUS["good"], told)]
    assert quality_summary([seen, noise])[0] == "1 of 1 good"
    unknown = noise | {"status": "not known"}
    assert lights([seen, unknown]) == [("Recordings", STATUS["good"], told)]
    assert lights([seen | {"status": "poor"}, noise]) == [
        ("Recordings", STATUS["poor"], "seen; not judged: noise")
    ]
    assert lights([noise]) == lights([unknown]) == []


def test_the_page_holds_the_scene_and_its_script():
    page = build_report(full_study(levelled=[falling()], touchdowns=landings()))
    assert page.count("<canvas") == 1
    assert 'class="small"' in page
    data = re.search(r'<script type="application/json">(.*?)</script>', page)[1]
    assert json.loads(data)["parts"]
