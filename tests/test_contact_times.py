"""Contacts of any number of feet, from the first landing on, without a study."""

import hashlib
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_up_hopper import MARKERS, hopping

import hopdata as hd
from hopdata.contact_times import (
    ContactTimes,
    _file_of,
    _loading,
    beside_plates_told,
    contacts,
)
from hopdata.errors import AnalysisError, ArgumentError, HopdataError
from hopdata.landings.contact_feet import _of_all_feet
from hopdata.landings.contact_rows import (
    COLUMNS,
    contact_rows,
    order_rows,
    untimed,
)
from hopdata.landings.contacts import descents
from hopdata.landings.contacts.find import find_landings, find_study_landings
from hopdata.messages import Message, Messages
from hopdata.recordings.wording import also
from hopdata.recordings.writers.contact_events import labels

RATE_HZ = 200.0
GRAVITY = 9.81
NOISE_M = 4e-4
STEP_S = 0.6


def falls(time, landings, *, up_s=0.24, rise_m=0.12):
    """Return the height of a foot that falls freely, touches at each instant, and stands."""
    height = np.zeros(len(time))
    for landing in landings:
        before = landing - time
        in_fall = (before > 0) & (before < up_s)
        speed = 0.6
        height[in_fall] = speed * before[in_fall] - 0.5 * GRAVITY * (
            before[in_fall] ** 2
        ) * (speed - rise_m / up_s) / (0.5 * GRAVITY * up_s)
        rises = (before >= up_s) & (before < 2 * up_s)
        height[rises] = rise_m * (2 * up_s - before[rises]) / up_s
    return height


def walking(
    landings_of, *, seed=1, duration_s=4.0, with_body=True, bob_m=0.0, bob_late_s=0.0
):
    """Return a recording whose feet land at given instants, over a body that bobs."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    names = list(landings_of)
    positions = np.zeros((len(time), len(names) + 3, 3))
    for foot, name in enumerate(names):
        positions[:, foot, 0] = 0.3 * foot
        positions[:, foot, 2] = 0.05 + falls(time, landings_of[name])
    bob = bob_m * np.sin(2 * np.pi * (time - bob_late_s) / STEP_S)
    for number, place in enumerate([(0.1, 0.1), (0.1, -0.1), (-0.1, 0.0)]):
        positions[:, len(names) + number, :2] = place
        positions[:, len(names) + number, 2] = 0.9 + bob
    positions += rng.normal(0, NOISE_M, positions.shape)
    body = [f"pelvis{k}" for k in range(3)]
    return hd.Recording.from_arrays(
        time,
        positions,
        [*names, *body],
        feet=names,
        body=body if with_body else [],
        name="walk",
    )


def alternating(n_steps=3, first_s=0.7):
    """Return landings of a left and of a right foot in turn, s."""
    left = [first_s + 2 * STEP_S * k for k in range(n_steps)]
    right = [instant + STEP_S for instant in left[: n_steps - 1]]
    return {"left": left, "right": right}


@pytest.mark.parametrize("with_body", [True, False])
def test_feet_that_land_in_turn_are_timed_though_the_body_hardly_falls(with_body):
    truth = alternating()
    found = contacts(walking(truth, with_body=with_body))
    assert found.table["found"].all()
    for foot, instants in truth.items():
        own = found.table[found.table["foot"] == foot]
        assert len(own) == len(instants)
        error = own["contact_s"].to_numpy() - np.array(instants)
        allowed = 4 * np.hypot(own["se_s"], own["common_s"])
        assert (np.abs(error) < allowed).all()
        assert own["se_s"].max() < 0.003
        assert set(own["side"]) == {foot}
    # Each landing is that of one foot, and has no order.
    assert (found.orders["feet"] == 1).all()
    assert found.orders["probability"].isna().all()
    assert found.orders["sure"].isna().all()


def test_one_foot_without_a_body_is_enough():
    found = contacts(walking({"hoof": [0.7, 1.9]}, with_body=False))
    assert found.table["contact_s"].to_numpy() == pytest.approx([0.7, 1.9], abs=0.002)
    assert list(found.table["side"]) == ["", ""]
    assert list(found.orders["order"]) == ["hoof", "hoof"]


def test_the_pairs_of_a_trot_land_together_in_an_order():
    fore_left = [0.7, 1.9, 3.1]
    fore_right = [1.3, 2.5]
    truth = {
        "LF": fore_left,
        "RH": [instant + 0.02 for instant in fore_left],
        "RF": fore_right,
        "LH": [instant - 0.015 for instant in fore_right],
    }
    found = contacts(walking(truth, bob_m=0.02))
    assert list(found.orders["order"]) == ["LF > RH", "LH > RF"] * 2 + ["LF > RH"]
    assert found.orders["sure"].all()
    assert (found.orders["probability"] > 0.99).all()


@pytest.mark.parametrize("bob_late_s", [0.1, 0.2, 0.3, 0.4, 0.5])
def test_what_lands_together_does_not_depend_on_the_trunk(bob_late_s):
    """A descent of the trunk may end between the contacts of a pair, or of a jump."""
    first = [0.7, 1.9, 3.1]
    truth = {
        "LF": first,
        "RF": [instant + 0.01 for instant in first],
        "LH": [instant + 0.14 for instant in first],
        "RH": [instant + 0.148 for instant in first],
    }
    with_trunk = contacts(walking(truth, bob_m=0.05, bob_late_s=bob_late_s))
    alone = contacts(walking(truth, with_body=False))
    assert list(alone.orders["order"]) == ["LF > RF", "LH > RH"] * 3
    assert list(with_trunk.orders["order"]) == list(alone.orders["order"])
    apart_s = np.abs(with_trunk.table["contact_s"] - alone.table["contact_s"])
    assert (apart_s < 4 * np.hypot(with_trunk.table["se_s"], alone.table["se_s"])).all()


def test_a_landing_whose_feet_touch_at_once_is_unsure():
    found = contacts(walking({"left": [1.0], "right": [1.0003]}, bob_m=0.01))
    (order,) = found.orders.to_dict("records")
    assert order["feet"] == 2
    assert not order["sure"]
    assert order["probability"] + order["runner_up_probability"] == pytest.approx(1)


def test_a_single_landing_of_a_hopper_is_timed():
    recording, truth = hd.synthesize("quadruped", simulation={"hops": 4}, seed=3)
    whole = contacts(recording)
    assert len(whole.orders) == len(truth.contact_times)
    until = truth.contact_times[0].max() + 0.12
    first = recording.part(slice(0, int(until * recording.rate_hz)))
    found = contacts(first)
    assert [str(one.code) for one in found.messages] == ["landings.floor_by_lowest"]
    own = found.table.set_index("foot").loc[list(recording.names("foot"))]
    error = own["contact_s"].to_numpy() - truth.contact_times[0]
    assert (np.abs(error) < 4 * np.hypot(own["se_s"], own["common_s"])).all()


def test_landings_that_the_body_shows_are_those_of_a_study():
    recording, _ = hd.synthesize("quadruped", simulation={"hops": 12}, seed=4)
    study = find_landings(recording)
    alone = find_landings(recording, of_feet=True)
    columns = [name for name in study if name.startswith(("contact", "se_"))]
    assert len(alone) == len(study)
    np.testing.assert_allclose(alone[columns], study[columns], rtol=1e-9)


def test_a_foot_that_stands_all_the_time_lands_nowhere():
    found = contacts(walking({"left": [], "right": []}))
    assert not len(found.table)
    assert not len(found.orders)
    assert "landings.no_landing" in [one.code for one in found.messages]
    assert "0 contacts" in repr(found)


def test_several_recordings_are_told_apart():
    one = walking(alternating(2))
    other = walking({"left": [1.0], "right": [1.01]}, seed=2)
    from dataclasses import replace

    found = contacts([one, replace(other, name="jump")])
    assert list(dict.fromkeys(found.table["recording"])) == ["walk", "jump"]
    assert list(found.orders["recording"]).count("jump") == 1


def test_lags_are_those_of_all_recordings_or_of_some():
    begin = np.array([0.7, 1.9, 3.1])
    later = {"near": 0.03, "far": 0.05}
    several = [
        replace(walking({"left": begin, "right": begin + late}, bob_m=0.02), name=name)
        for name, late in later.items()
    ]
    found = contacts(several)
    for name, late in later.items():
        (lag,) = found.lags(name).to_dict("records")
        assert (lag["foot"], lag["other"], lag["landings"]) == ("left", "right", 3)
        assert lag["mean_s"] == pytest.approx(-late, abs=0.002)
        assert lag["low_s"] < lag["mean_s"] < lag["high_s"]
    assert found.lags().loc[0, "landings"] == 6
    assert found.lags().equals(found.lags(["near", "far"]))
    with pytest.raises(ArgumentError, match="near, far, found 'another'"):
        found.lags("another")
    first = found.lags(landings=[1]).loc[0]
    assert first["landings"] == len(found.recordings)
    assert found.lags("near", landings=[1, 2]).loc[0, "landings"] == 2
    with pytest.raises(ArgumentError, match="landings: expected numbers from 1 to"):
        found.lags(landings=[99])
    assert contacts(walking(alternating())).lags().empty, "one foot after the other"


def test_events_are_the_contacts_that_can_be_trusted():
    found = contacts(walking(alternating()))
    events = found.events("walk")
    assert [event.time_s for event in events] == sorted(found.found["contact_s"])
    assert [event.context for event in events] == ["Left", "Right"] * 2 + ["Left"]
    assert found.events() == events
    with pytest.raises(ArgumentError, match="expected one of walk, found 'another'"):
        found.events("another")


def test_events_of_four_feet_have_side_and_name():
    names = ("LF_TOE", "RF_TOE", "LH_TOE", "RH_TOE")
    starts = zip(names, ([1.0], [1.02], [1.1], [1.13]), strict=True)
    events = contacts(walking(dict(starts))).events("walk")
    assert [event.foot for event in events] == list(names)
    assert [event.context for event in events] == ["Left", "Right"] * 2
    told = zip(names, labels(events), strict=True)
    assert all(name in label for name, label in told)


def test_curves_surround_the_contacts():
    found = contacts(walking(alternating()))
    curves = found.curves(found.orders.head(2))
    assert sorted(set(curves["landing"])) == [1, 2]
    first = curves[curves["landing"] == 1]
    contact_s = found.table["contact_s"].iloc[0]
    assert first["time_s"].min() < contact_s < first["time_s"].max()
    assert abs(first["height_m"].iloc[-1]) < 0.005
    assert first["height_m"].max() > 0.02


def test_what_has_no_foot_is_refused():
    recording = walking({"left": [1.0]})
    rising = np.linspace(0.5, 2.0, 300)[:, None, None] * np.ones(3)
    without = hd.Recording.from_arrays(np.arange(300) / 100, rising, ["wand"])
    with pytest.raises(AnalysisError, match=r"at least 1 foot marker.*with_roles"):
        contacts(without)
    for wrong in (3, [recording, None], []):
        with pytest.raises(ArgumentError, match="recordings: expected a recording"):
            contacts(wrong)
    with pytest.raises(hd.HopdataError, match=r"jump\.c3d: expected a file"):
        contacts(["jump.c3d"])


@pytest.mark.parametrize(
    "feet",
    [
        ["left"],
        {"left": ["left"]},
        [{"name": "left", "markers": ["left"]}],
    ],
)
def test_named_feet_in_any_form_are_the_only_ones(feet):
    found = contacts(walking(alternating(2)), feet=feet)
    assert found.feet == ["left"]
    assert len(found.table) == 2
    assert found.recordings[0].names("body") == ("pelvis0", "pelvis1", "pelvis2")


def test_no_feet_are_those_of_the_recording():
    recording = walking(alternating(2))
    assert contacts(recording, feet=None).feet == contacts(recording).feet


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"feet": [{"name": "l", "markers": ["lef"]}]}, "did you mean 'left'"),
        ({"feet": [{"name": "l", "marker": ["left"]}]}, "feet: expected a list"),
        ({"feet": "left"}, "feet: expected a list"),
        ({"feet": 5}, "feet: expected a list"),
        ({"feet": {"l": ["left"], "r": ["left"]}}, "each name once"),
        ({"gravty": 9.8}, "did you mean 'gravity'"),
        ({"maximum_misfit": "x"}, "maximum_misfit: expected a number"),
        ({"floor": 3}, "floor: expected"),
        ({"sure": 90}, "sure: expected a probability, 0 to 1, found 90"),
    ],
)
def test_mistakes_are_told_in_one_line(given, told):
    with pytest.raises(HopdataError) as caught:
        contacts(walking(alternating(1)), **given)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_remarks_are_lines():
    remarks = Messages(
        [Message("landings.contact_thin"), Message("landings.no_contact")]
    )
    told = "too few frames to time it\nno contact"
    assert str(remarks) == repr(remarks) == told
    none = pd.DataFrame()
    found = ContactTimes(none, none, remarks, ())
    assert "\n".join(found.remarks) == repr(found.remarks) == told
    assert found.remarks[1] == "no contact"


def test_one_contact_loads_a_plate():
    assert _loading(1) == "1 contact loads"
    assert _loading(2) == "2 contacts load"


def test_feet_that_are_all_timed_need_no_study_of_their_own():
    rest = Message("recordings.feet_rest", {"often": "3", "percent": 18.0})
    between = Message("recordings.feet_in_between", {"markers": "LHEE"})
    assert _of_all_feet(also(rest, between)) == rest
    assert _of_all_feet(between) is None


def test_a_recording_knows_the_file_that_it_was_read_from(tmp_path):
    file = tmp_path / "walk.csv"
    file.write_text("as read")
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    recording = replace(walking(alternating(1)), source=str(file), source_sha256=digest)
    assert _file_of(recording) == [file]
    file.write_text("another one")
    assert _file_of(recording) == []
    assert _file_of(walking(alternating(1))) == []


@pytest.mark.parametrize(
    ("left", "right", "told"),
    [
        (descents.POOR_FIT, descents.RISES, "left: poor fit, right: rises"),
        (descents.POOR_FIT, descents.NOT_LANDED, "left: poor fit)"),
        (descents.MISSING, descents.NOT_LANDED, None),  # may not have landed
        (descents.POOR_FIT, descents.LANDED, None),  # has its row
        (descents.NOT_LANDED, descents.ALREADY_DOWN, None),
    ],
)
def test_a_landing_of_which_no_foot_is_timed_is_told(left, right, told):
    recording = walking(alternating())
    instant = np.nan
    if right == descents.LANDED:
        instant = 0.4
    landing = {"begin_s": 0.2, "end_s": 0.5, "status_left": left, "status_right": right}
    landing |= {"contact_left_s": np.nan, "contact_right_s": instant}
    remarks = untimed(recording, pd.DataFrame([landing]))
    if told is None:
        assert not remarks
    else:
        assert told in str(remarks[0])
        assert "1 landing left out" in str(remarks[0])
        assert "0.20 to 0.50 s" in str(remarks[0])


@pytest.mark.parametrize(("instant", "is_told"), [(0.4, False), (0.6, True)])
def test_a_landing_that_another_row_times_is_not_left_out(instant, is_told):
    recording = walking(alternating())
    lost = {"begin_s": 0.2, "end_s": 0.5, "contact_left_s": np.nan}
    lost |= {"status_left": descents.POOR_FIT, "status_right": descents.NOT_LANDED}
    timed = {"begin_s": 0.3, "end_s": 0.7, "contact_left_s": instant}
    timed |= {"status_left": descents.LANDED, "status_right": descents.NOT_LANDED}
    landings = pd.DataFrame([lost, timed]).assign(contact_right_s=np.nan)
    assert bool(untimed(recording, landings)) == is_told


def test_the_names_of_markers_change_no_digit():
    toes = alternating()
    heels = {side: [at + 0.02 for at in own] for side, own in toes.items()}
    found = []
    for names in (("a", "b", "c", "d"), ("d", "b", "a", "c"), ("c", "d", "b", "a")):
        own = [toes["left"], heels["left"], toes["right"], heels["right"]]
        recording = walking(dict(zip(names, own, strict=True)))
        feet = {"left": names[:2], "right": names[2:]}
        table = contacts(recording, feet=feet).table
        first = dict(zip(names, ("a", "b", "c", "d"), strict=True))
        found.append(table.assign(marker=table["marker"].map(first)))
    for other in found[1:]:
        pd.testing.assert_frame_equal(found[0], other, check_exact=True)


FOOT_MARKERS = {"left": ["heel", "toe"], "right": ["hoof"]}


def striking(late_s, *, seed=1, n_steps=3):
    """Return contacts of a foot whose toe follows its heel, and of one of one marker."""
    steps = alternating(n_steps)
    toe = [at + late for at, late in zip(steps["left"], late_s, strict=True)]
    own = {"heel": steps["left"], "toe": toe, "hoof": steps["right"]}
    recording = walking(own, seed=seed, duration_s=2 * STEP_S * n_steps + 0.5)
    return contacts(recording, feet=FOOT_MARKERS).table


@pytest.mark.parametrize(("late_s", "first"), [(0.02, "heel"), (-0.02, "toe")])
def test_the_marker_of_a_foot_that_touches_first_is_told(late_s, first):
    table = striking([late_s] * 3)
    left = table[table["foot"] == "left"]
    assert set(left["marker"]) == {first}
    assert (left["marker_probability"] > 0.95).all()
    # A foot of one marker has no other that might be first.
    right = table[table["foot"] == "right"]
    assert set(right["marker"]) == {"hoof"}
    assert right["marker_probability"].isna().all()


def test_no_marker_is_surely_first_that_the_errors_do_not_tell():
    """Whether one marker yields more than the other, contacts do not show."""
    flat = striking([0.0, 2e-4, -2e-4])
    assert flat.loc[flat["foot"] == "left", "marker_probability"].max() < 0.9
    rng = np.random.default_rng(5)
    told = []
    for seed in range(4):
        late_s = rng.normal(0, 0.002, 6)
        table = striking(late_s, seed=seed, n_steps=6)
        left = table[table["foot"] == "left"]
        is_right = left["marker"].to_numpy() == np.where(late_s > 0, "heel", "toe")
        told += zip(left["marker_probability"], is_right, strict=True)
    probability, is_right = np.array(told).T
    is_sure = probability > 0.9
    assert is_sure.sum() > 5
    assert (~is_sure).sum() > 5
    assert is_right[is_sure].mean() >= 0.9


def test_a_contact_that_is_not_found_has_no_marker_and_neither_has_one_height():
    (recording,) = contacts(walking(alternating())).recordings  # levelled
    (landings,) = find_study_landings([recording], of_feet=True)
    is_left = landings["status_left"] == descents.LANDED
    place = COLUMNS.index("marker")
    for status, marker in [(descents.LANDED, "left"), (descents.POOR_FIT, "")]:
        given = landings[is_left].assign(status_left=status)
        rows = contact_rows(recording, given)
        assert {row[place] for row in rows if "left" in row[2]} == {marker}
    # To a printed method the markers of a foot are one height.
    steps = alternating()
    own = {"heel": steps["left"], "toe": steps["left"], "hoof": steps["right"]}
    by_velocity = contacts(walking(own), feet=FOOT_MARKERS, method="velocity_minimum")
    named = by_velocity.table.groupby("foot")["marker"].unique()
    assert named["left"].tolist() == [""]
    assert named["right"].tolist() == ["hoof"]


@pytest.mark.parametrize(
    ("runner", "hind", "least"),
    [("quick_runner", {"Heel.Bottom"}, 0.95), ("forefoot_runner", {"MT1", "MT5"}, 0.8)],
)
def test_who_lands_on_the_heel_and_who_on_the_forefoot_are_told_apart(
    request, runner, hind, least
):
    names = ("Heel.Bottom", "MT1", "MT5")
    feet = {side: [f"{side}.{name}" for name in names] for side in "LR"}
    found = contacts(request.getfixturevalue(runner), feet=feet).found
    assert len(found) > 75
    sure = found[found["marker_probability"] > 0.9]
    assert len(sure) > least * len(found)
    assert set(sure["marker"].str[2:]) <= hind


@pytest.mark.parametrize(("contact_s", "end_s"), [(0.4, 0.5), (0.6, 0.6)])
def test_a_landing_holds_its_contacts(contact_s, end_s):
    recording = walking(alternating())
    landing = {"begin_s": 0.2, "end_s": 0.5}
    for foot, at_s in (("left", contact_s), ("right", np.nan)):
        landing[f"contact_{foot}_s"] = at_s
        landing[f"se_{foot}_s"] = 0.001
        landing[f"status_{foot}"] = descents.LANDED
    rows = order_rows(recording, pd.DataFrame([landing]), 0.9)
    assert rows[0][2:4] == (0.2, end_s)


def test_scatter_beside_plates_is_told_with_what_the_errors_state():
    late_s = np.tile([0.003, 0.005, 0.001], 4)
    table = pd.DataFrame({"contact_s": np.arange(12) + late_s})
    table["plate_s"] = np.arange(12.0)
    # The right foot is 10 ms later in all: that is no scatter.
    table["foot"] = ["left"] * 6 + ["right"] * 6
    table.loc[6:, "contact_s"] += 0.01
    table = table.assign(se_s=0.0003, plate_se_s=0.0004, common_s=0.002)
    table.loc[6:, "common_s"] = 0.0031
    (told,) = beside_plates_told(table)
    scatter = told.values["scatter"].values
    assert scatter["scatter_ms"] == pytest.approx(2.0 * np.sqrt(8 / 10))
    assert scatter["stated_ms"] == pytest.approx(0.5)
    assert told.values["most_ms"] == pytest.approx(15.0)
    each = "left +3.0 ms (common error 2 ms), right +13.0 ms (common error 3.1 ms)"
    assert told.values["offsets"].values["each"] == each
    assert each in str(told)
    (told,) = beside_plates_told(table.head(6))
    assert "too few" in str(told)
    assert beside_plates_told(table.assign(plate_s=np.nan)) == []


@pytest.mark.parametrize(
    "span", [(0.9, 0.8), (90.0, 91.0), 0.5, (0.1, "b"), (0.1, 0.2, 3), {"from_s": 0.1}]
)
def test_a_span_that_is_none_is_refused(span):
    with pytest.raises(ArgumentError, match="exclude"):
        contacts(walking(alternating()), exclude=[span])


def test_contacts_in_an_excluded_span_are_not_timed():
    truth = alternating()
    second_s = truth["left"][1]
    spans = [(second_s - 0.1, second_s + 0.1)]
    found = contacts(walking(truth), exclude=spans)
    left = found.found.query("foot == 'left'")["contact_s"]
    assert np.abs(left - second_s).min() > 0.1
    assert len(left) == len(truth["left"]) - 1
    assert found.messages[0].code == "landings.spans_excluded"


@pytest.mark.parametrize("is_mapping", [True, False])
def test_the_reason_of_an_excluded_span_stands_wherever_it_is_told(is_mapping):
    first = np.array([0.7, 1.9, 3.1])
    recording = walking({"left": first, "right": first + 0.04}, bob_m=0.02)
    span = (1.93, 2.2, "a person in the way")
    if is_mapping:
        span = dict(zip(("from_s", "to_s", "reason"), span, strict=True))
    found = contacts(recording, exclude=[span])
    assert "1.93 to 2.2 s (a person in the way)" in found.remarks[0]
    hidden = found.table.query("not found")
    assert [*hidden["foot"]] == ["right"]
    assert [*hidden["remark"]] == ["by hand: a person in the way"]
    text = found.methods().text
    assert "(a person in the way) of walk were left out by hand." in text
    without = contacts(recording, exclude=[(1.93, 2.2)])
    assert [*without.table.query("not found")["remark"]] == [
        "frames missing at the contact"
    ]
    assert "[say why]" in without.methods().text


def test_feet_that_are_hidden_at_their_contacts_are_told_with_number_and_time():
    first = np.array([0.7, 1.9, 3.1])
    recording = walking({"left": first, "right": first + 0.04}, bob_m=0.02)
    code = "landings.contacts_hidden"
    assert code not in [one.code for one in contacts(recording).messages]
    in_turn = contacts(walking(alternating()))
    assert code not in [one.code for one in in_turn.messages]
    right = recording.markers.index("right")
    recording.positions[recording.time > 1.6, right] = np.nan
    found = contacts(recording)
    (told,) = [one for one in found.messages if one.code == code]
    assert told.values["foot"] == "right"
    assert (told.values["hidden"], told.values["landings"]) == (2, 3)
    assert told.values["from_s"] < 1.9
    assert told.values["to_s"] > 3.1
    recording.positions[recording.time > 3.3, right] = 0.05  # seen again, standing
    (again,) = [one for one in contacts(recording).messages if one.code == code]
    assert (again.values["hidden"], again.values["landings"]) == (2, 3)
    assert "right is hidden where it should touch in 2 of 3 landings" in str(told)


def landed(commons):
    """Return contacts of feet with common errors, s; two landings of each."""
    rows = [(foot, common) for foot, common in commons.items() for _ in range(2)]
    table = pd.DataFrame(rows, columns=["foot", "common_s"])
    table = table.assign(found=True, se_s=1e-4)
    orders = pd.DataFrame({"probability": [np.nan, np.nan], "sure": [None, None]})
    return ContactTimes(table, orders, Messages(()), ())


@pytest.mark.parametrize(
    ("commons", "told"),
    [
        (
            {"left": 2.2e-4, "right": 3.1e-4},
            ", common error left 0.22 ms, right 0.31 ms",
        ),
        ({"left": 2e-4, "right": 2e-4}, ", common error 0.2 ms (of each foot)"),
        ({"left": 2e-4}, ", common error 0.2 ms (of the foot)"),
        ({"left": np.nan}, "standard error 0.1 ms (median)"),
    ],
)
def test_the_common_error_of_each_foot_stands_beside_the_standard_error(commons, told):
    assert str(landed(commons)).endswith(told)


def test_of_a_landing_half_in_an_excluded_span_the_foot_outside_is_timed():
    first = np.array([0.7, 1.9, 3.1])
    recording = walking({"left": first, "right": first + 0.04}, bob_m=0.02)
    assert len(contacts(recording).orders) == 3
    half = contacts(recording, exclude=[(1.93, 2.2)])
    assert len(half.orders) == 3
    timed = half.found.groupby("foot")["contact_s"].apply(list)
    assert timed["left"] == pytest.approx(first, abs=0.003)
    assert timed["right"] == pytest.approx(first[[0, 2]] + 0.04, abs=0.003)
    assert len(contacts(recording, exclude=[(1.5, 2.2)]).orders) == 2


def test_the_methods_paragraph_states_both_errors_the_feet_and_what_was_left_out():
    truth = alternating()
    spans = [(truth["left"][1] - 0.1, truth["left"][1] + 0.1)]
    found = contacts(walking(truth), exclude=spans)
    text = found.methods().text
    assert f"{1e3 * found.median_se_s:.2g} ms in the median" in text
    for foot, own in found.found.groupby("foot"):
        assert f"{1e3 * own['common_s'].max():.2g} ms ({foot})" in text
    assert f"{len(found.found)} were timed" in text
    assert "left out by hand" in text
    assert "left out" not in contacts(walking(truth)).methods().text


def test_the_methods_paragraph_says_what_the_probability_of_an_order_is():
    truth = alternating()
    together = {"left": truth["left"], "right": [one + 0.04 for one in truth["left"]]}
    found = contacts(walking(together, bob_m=0.02))
    n_sure = int(found.orders["sure"].sum())
    text = found.methods().text
    assert "independent normal errors with the standard errors" in text
    assert f"{n_sure} have a sure order (a probability of 0.9 or more" in text
    surer = contacts(walking(together, bob_m=0.02), sure=0.999).methods().text
    assert "a probability of 0.999 or more" in surer
    assert "force plate" not in text, "there is none"
    alone = contacts(walking(truth)).methods().text
    assert "sure order" not in alone


@pytest.mark.parametrize(
    ("method", "told"),
    [("kink", "maximum likelihood"), ("velocity_minimum", "velocity of its marker")],
)
def test_the_methods_paragraph_tells_of_the_method_that_was_asked_for(method, told):
    text = contacts(walking(alternating()), method=method).methods().text
    assert told in text
    assert ("maximum likelihood" in text) == (method == "kink")


def test_millimetres_taken_for_metres_are_told():
    recording, _ = hd.synthesize("hopper", simulation={"hops": 20}, seed=5)
    feet = [name for name in recording.markers if name.startswith("foot")]
    body = [name for name in recording.markers if name.startswith("body")]

    def made(factor):
        positions = factor * recording.positions
        names = recording.markers
        return hd.Recording.from_arrays(
            recording.time, positions, names, feet=feet, body=body
        )

    assert len(contacts(made(1.0)).found) == 60
    with pytest.raises(HopdataError, match=r"multiply the positions by 0\.001"):
        contacts(made(1000.0))


def cropped(first, stop):
    """Return frames of a hopper whose first landing is at frame 30, and its last at 448."""
    time, positions = hopping(1, n_frames=500)
    feet = MARKERS[3:6]
    return hd.Recording.from_arrays(
        time[first:stop],
        positions[first:stop, :6],
        MARKERS[:6],
        feet=feet,
        body=MARKERS[:3],
        name=f"hop{first}",
    )


@pytest.mark.parametrize(
    ("first", "stop", "told"),
    [
        (0, 500, ""),
        (0, 425, ""),  # ends in the air
        (31, 500, "1 landing left out, since the recording begins or ends in it"),
        (0, 449, "hop0 (end)"),
        (31, 449, "2 landings left out"),
    ],
)
def test_a_landing_that_the_recording_cuts_off_is_told(first, stop, told):
    remarks = [
        str(remark)
        for remark in hd.contacts(cropped(first, stop)).remarks
        if "left out" in remark
    ]
    assert len(remarks) == bool(told)
    assert told in "".join(remarks)


def test_landings_cut_off_in_several_recordings_are_told_in_one_remark():
    found = hd.contacts([cropped(first, 500) for first in (0, 31, 33)])
    (remark,) = [one for one in found.remarks if "begins or ends" in one]
    assert remark.startswith("2 landings left out")
    assert "hop31 (begin), hop33 (begin)" in remark
