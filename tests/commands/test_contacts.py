"""``hopdata contacts``: the table, the page and the events of a file."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_up_files import export
from made_up_hopper import MARKERS, hopping
from plate_files import CORNERS, PlateFile, Stance, write_plates
from written_files import write_c3d

import hopdata as hd
from hopdata.__main__ import main
from hopdata.commands.contacts import (
    Trial,
    _is_of_maps,
    _notes_of,
    name_apart,
    one_of_a_kind,
)
from hopdata.commands.contacts_instead import write_few
from hopdata.config.loading import load_config
from hopdata.inspecting import listing
from hopdata.messages import Message
from hopdata.recording import Recording
from hopdata.recordings.quality.guess import Guess
from hopdata.recordings.raw import RawRecording
from hopdata.recordings.readers.c3d import read_c3d


@pytest.fixture
def recording(tmp_path, monkeypatch):
    """Return a file of eight hops, with the working folder beside it."""
    monkeypatch.chdir(tmp_path)
    return export(tmp_path, hopping(1, n_frames=500)[1])


def test_contacts_of_a_file_are_listed_with_guessed_feet(recording, capsys):
    assert main(["contacts", str(recording)]) == 0
    out = capsys.readouterr().out
    assert re.match(r"\d+ contacts in 8 landings, standard error", out)
    assert "note: feet guessed: toe1 toe2 toe3" in out  # the only file is not named
    assert re.search(r"^  1 .*toe\d \d+\.\d ± \d\.\d.* > toe\d", out, re.MULTILINE)


def test_notes_on_what_only_maps_depend_on_are_left_out():
    def note(code):
        return Message("recordings.at", {"place": "a", "remark": Message(code)})

    assert _is_of_maps(note("recordings.soft"))
    assert not _is_of_maps(note("recordings.unseen"))
    assert not _is_of_maps(Message("recordings.as_read", {"text": "soft"}))


def test_exchanged_markers_are_told_of(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    positions = hopping(1, n_frames=500)[1]
    sound = export(tmp_path, positions, name="sound.tsv")
    feet = [MARKERS.index("toe1"), MARKERS.index("toe2")]
    positions[200:240, feet] = positions[200:240, feet[::-1]]
    exchanged = export(tmp_path, positions, name="exchanged.tsv")
    assert main(["contacts", str(sound)]) == 0
    assert "See 'hopdata inspect'" not in capsys.readouterr().out
    main(["contacts", str(exchanged)])
    assert re.search(r"swap.* See 'hopdata inspect'", capsys.readouterr().out)


def test_an_unnamed_limb_that_rests_is_told_of_and_what_it_does(recording, capsys):
    text = recording.read_text("utf-8")
    recording.write_text(text.replace("toe3", "wrist"), "utf-8")
    told = "wrist come to rest on the floor as often and as low as the feet"
    assert main(["contacts", str(recording)]) == 0
    out = capsys.readouterr().out
    assert told in out
    assert "the foot's instant errs by more than is stated" in out
    assert main(["contacts", str(recording), "--feet", "toe1", "toe2", "wrist"]) == 0
    assert told not in capsys.readouterr().out


@pytest.mark.parametrize(("stated", "is_told"), [("mm", False), ("m", True)])
def test_a_stated_unit_that_cannot_be_is_told_of(tmp_path, capsys, stated, is_told):
    time, positions = hopping(1, n_frames=500)
    file = tmp_path / "one.c3d"
    write_c3d(file, RawRecording(MARKERS, time, 1000 * positions, 100.0, stated))
    assert main(["contacts", str(file)]) == 0
    told = capsys.readouterr().out
    assert ("the file states m; taken for mm" in told) == is_told
    remarks = str(hd.contacts(file).remarks)
    assert ("expected m as stated" in remarks) == is_told
    assert main(["contacts", str(file), "--unit", "mm"]) == 0
    assert "states" not in capsys.readouterr().out


def test_one_named_foot_is_enough(recording, capsys):
    assert main(["contacts", str(recording), "--feet", "toe2"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("8 contacts in 8 landings")
    assert "feet guessed" not in out
    head, first = out.splitlines()[1:3]
    assert re.split("  +", head.strip()) == [
        "landing",
        "contact (s)",
        "foot (± standard error, ms)",
    ]
    assert re.fullmatch(r"  1 +\d\.\d{4} +toe2 ± \d\.\d", first)


def test_the_table_has_the_same_columns_for_one_foot_and_for_several(recording, capsys):
    columns = []
    for feet in (["toe1", "toe2"], ["toe2"]):  # the second call tidies up
        given = ["--feet", *feet, "--force"]
        assert main(["contacts", str(recording), "-o", "a.csv", *given]) == 0
        columns.append([*pd.read_csv("a.csv")])
        out = capsys.readouterr().out
        has_orders = "probability" in out
        assert has_orders == (len(feet) > 1)
        assert ("orders: none" in out) == (not has_orders)
        assert Path("a_orders.csv").exists() == has_orders
        assert Path("a_lags.csv").exists() == has_orders
        assert ("toe1 minus toe2" in out) == has_orders
        Path("a.csv").unlink()
    assert columns[0] == columns[1]


def test_markers_are_joined_to_a_foot_and_the_first_counts(recording, tmp_path, capsys):
    apart = tmp_path / "apart.csv"
    joined = tmp_path / "joined.csv"
    assert main(["contacts", str(recording), "--out", str(apart)]) == 0
    feet = ["--feet", "left=toe1,toe2", "toe3"]
    page = tmp_path / "joined.html"
    given = [*feet, "--out", str(joined), "--html", str(page)]
    assert main(["contacts", str(recording), *given]) == 0
    out = capsys.readouterr().out
    assert re.search(r"left \(toe[12] first [01]\.\d\d\) \d", out)
    assert "(toe3" not in out  # a foot of one marker
    assert "first marker" in page.read_text("utf-8")
    of_apart = pd.read_csv(apart)
    of_joined = pd.read_csv(joined)
    assert set(of_joined["foot"]) == {"left", "toe3"}
    first = of_apart[of_apart["foot"] != "toe3"].groupby("landing")["contact_s"].min()
    of_left = of_joined[of_joined["foot"] == "left"].set_index("landing")["contact_s"]
    assert np.abs(first - of_left).max() < 0.004
    by_foot = of_joined.groupby("foot")
    assert set(by_foot["marker"].unique()["left"]) <= {"toe1", "toe2"}
    assert by_foot["marker_probability"].count().to_dict() == {"left": 8, "toe3": 0}
    given = ["--feet", "left=toe1", "right=toe3", "--events", "csv"]
    assert main(["contacts", str(recording), *given]) == 0
    (events,) = Path().glob("*_contacts.csv")
    assert set(pd.read_csv(events)["context"]) == {"Left", "Right"}


def test_files_are_written_before_anything_is_printed(recording, monkeypatch):
    # A pipe into `head` ends the command with the first lines.
    there = []

    def show(*_given, **_options):
        there.extend(file.name for file in Path().glob("*.csv"))

    monkeypatch.setattr("hopdata.commands.contacts.show", show)
    given = ["contacts", str(recording), "--out", "c.csv", "--events", "csv"]
    assert main(given) == 0
    assert {
        "c.csv",
        "c_orders.csv",
        "c_lags.csv",
        f"{recording.stem}_contacts.csv",
    } <= {*there}


def test_tables_and_page_are_written(recording, tmp_path, capsys):
    out = tmp_path / "new" / "contacts.csv"
    page = tmp_path / "contacts.html"
    given = ["contacts", str(recording), "--out", str(out), "--html", str(page)]
    assert main(given) == 0
    table = pd.read_csv(out)
    orders = pd.read_csv(tmp_path / "new" / "contacts_orders.csv")
    assert len(orders) == 8
    lags = pd.read_csv(tmp_path / "new" / "contacts_lags.csv")
    assert len(lags) == 3, "two of three toes"
    assert (lags["low_s"] < lags["mean_s"]).all()
    printed = capsys.readouterr().out.partition("median |lag|")[2]
    assert " -" in printed
    assert "\N{MINUS SIGN}" not in printed
    assert (table["landing"].value_counts() <= 3).all()
    text = page.read_text("utf-8")
    # The page's script has the type as well, but no data in base 64.
    assert text.count("data:image/svg+xml;base64,") == 2
    assert "Each landing" in text
    assert "Lags of the feet" in text
    assert "toe1 minus toe2" in text
    assert "after plate" not in text  # the file has none
    assert "://" not in re.sub(r"https?://www\.w3\.org", "", text)
    # What is there is not replaced, and the recording never.
    capsys.readouterr()
    assert main(given) == 1
    assert "--force replaces it" in capsys.readouterr().err
    assert main([*given[:4], "--force"]) == 0
    assert main(["contacts", str(recording), "-o", str(recording), "--force"]) == 1
    assert "that of a recording that was read" in capsys.readouterr().err


def test_events_of_each_format_are_written(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    time, positions = hopping(1, n_frames=300)
    path = tmp_path / "jump.c3d"
    write_c3d(path, RawRecording(MARKERS, time, 1000 * positions, 100.0, "mm"))
    before = path.read_bytes()
    given = ["contacts", str(path), "--events", "c3d", "csv", "bids", "opensim"]
    assert main([*given, "--to", "events"]) == 0
    assert path.read_bytes() == before
    assert sorted(one.name for one in (tmp_path / "events").iterdir()) == [
        "jump_contacts.c3d",
        "jump_contacts.csv",
        "jump_contacts.sto",
        "jump_events.json",
        "jump_events.tsv",
    ]
    table = pd.read_csv(tmp_path / "events" / "jump_contacts.csv")
    events = read_c3d(tmp_path / "events" / "jump_contacts.c3d").events
    assert [one.time_s for one in events] == pytest.approx(
        list(table["time_s"]), abs=1e-5
    )
    capsys.readouterr()
    assert main([*given, "--to", "events"]) == 1
    assert "--force replaces it" in capsys.readouterr().err


def test_events_of_c3d_need_a_c3d(recording, capsys):
    assert main(["contacts", str(recording), "--events", "c3d"]) == 1
    assert "--events c3d: expected a single C3D file" in capsys.readouterr().err


def test_frames_of_a_span_can_count_as_unseen(recording, tmp_path, capsys):
    out = tmp_path / "contacts.csv"
    given = ["contacts", str(recording), "--out", str(out), "--force"]
    assert main(given) == 0
    instants = pd.read_csv(out)["contact_s"]
    middle_s = instants.median()
    span = [f"{middle_s - 0.1:.3f}", f"{middle_s + 0.1:.3f}"]
    assert main([*given, "--exclude", *span]) == 0
    out_told = capsys.readouterr().out
    assert "count as unseen, by hand" in out_told
    assert "wholly inside" in out_told
    kept = pd.read_csv(out)
    kept = kept[kept["found"]]["contact_s"]
    assert not kept.between(*map(float, span)).any()
    # The landings that are a stride away stay.
    assert len(kept) > 0.6 * len(instants)
    assert main([*given, "--exclude", span[0]]) == 1
    assert "begin and end of each span" in capsys.readouterr().err
    reasons = ["--reason", "one", "two"]
    assert main([*given, "--exclude", *span, *reasons]) == 1
    assert "one for each of 1 spans" in capsys.readouterr().err
    assert main([*given, "--exclude", *span, "--reason", "a shoe came off"]) == 0
    assert "s (a shoe came off) count as unseen" in capsys.readouterr().out
    assert main([*given, "--reason", "none"]) == 1
    assert "spans of --exclude with it" in capsys.readouterr().err


def test_a_marker_that_is_not_there_is_refused(recording, capsys):
    assert main(["contacts", str(recording), "--feet", "toe9"]) == 1
    assert "--feet: expected markers of" in capsys.readouterr().err
    assert main(["contacts", str(recording), "--body", "hips1"]) == 1
    assert "did you mean" in capsys.readouterr().err


def test_a_configuration_gives_roles_and_options(recording, tmp_path, capsys):
    config = tmp_path / "study.yaml"
    config.write_text(
        "study: trial\n"
        f"recordings:\n  - {{name: one, file: {recording}}}\n"
        "markers: {body: [hip1, hip2, hip3], feet: [toe1, toe2]}\n"
        "touchdowns: {ambiguous_below: 0.999999}\n"
    )
    assert main(["contacts", str(config)]) == 0
    out = capsys.readouterr().out
    assert "toe3" not in out
    assert "feet guessed" not in out


def few_landings(tmp_path, n_frames):
    """Return the configuration of a study of so many frames of hops."""
    file = export(tmp_path, hopping(1, n_frames=n_frames)[1])
    return load_config(
        {
            "study": "trial",
            "recordings": [{"name": "one", "file": str(file)}],
            "markers": {"body": ["hip1", "hip2", "hip3"], "feet": ["toe1", "toe2"]},
        }
    )


def test_a_study_that_stopped_for_want_of_landings_gets_its_contacts(tmp_path, capsys):
    folder = tmp_path / "results"
    assert write_few(few_landings(tmp_path, 130), folder)
    told = capsys.readouterr().out
    assert "too few landings for maps and a verdict: 2 found, at least 3" in told
    assert "maps need at least 3 landings: record more" in told
    assert "set sections" not in told
    assert len(pd.read_csv(folder / "tables" / "contacts_orders.csv")) == 2
    assert len(pd.read_csv(folder / "tables" / "contacts_lags.csv")) == 1
    assert "too few landings" in (folder / "contacts.html").read_text("utf-8")


def test_a_study_with_landings_enough_did_not_stop_for_want_of_them(tmp_path, capsys):
    folder = tmp_path / "results"
    assert not write_few(few_landings(tmp_path, 400), folder)
    assert capsys.readouterr().out == ""
    assert not folder.exists()


def test_a_file_without_a_landing_says_so_with_exit_code_1(tmp_path, capsys):
    standing = hopping(1, n_frames=500)[1]
    rng = np.random.default_rng(1)
    standing[:] = standing[0] + rng.normal(0, 6e-4, standing.shape)
    file = export(tmp_path, standing)
    assert main(["contacts", str(file), "--feet", "toe1", "toe2"]) == 1
    assert "no landing found" in capsys.readouterr().out
    # Tables and events have their columns, and no row.
    given = ["--out", "none.csv", "--html", "none.html", "--events", "csv", "bids"]
    given += ["opensim", "--to", str(tmp_path / "events")]
    given = [str(tmp_path / one) if one.startswith("none") else one for one in given]
    assert main(["contacts", str(file), "--feet", "toe1", "toe2", *given]) == 1
    assert pd.read_csv(tmp_path / "none.csv").empty
    events = pd.read_csv(tmp_path / "events" / f"{file.stem}_contacts.csv")
    assert len(events.columns) == 6
    assert events.empty


def test_events_that_cannot_be_written_are_refused_before_any_work(
    recording, tmp_path, capsys
):
    again = tmp_path / "other" / recording.name
    again.parent.mkdir()
    again.write_bytes(export(tmp_path / "other", hopping(2)[1]).read_bytes())
    both = ["contacts", str(recording), str(again), "--force", "--out", "both.csv"]
    # Two files of one name would write the same events.
    assert main([*both, "--events", "csv"]) == 1
    err = capsys.readouterr().err
    assert "expected events of one recording" in err
    assert str(again) in err
    assert main([*both, "--events", "c3d"]) == 1
    assert "expected a single C3D file" in capsys.readouterr().err
    assert not (tmp_path / "both.csv").exists()
    # The table holds both, under names of their own.
    assert main(both) == 0
    names = [recording.stem, f"{recording.stem}_2"]
    assert list(pd.read_csv("both.csv")["recording"].unique()) == names


def test_a_name_that_another_file_has_is_not_given_to_a_second():
    recordings = [
        Recording.from_arrays(
            [0.0, 0.01], np.zeros((2, 1, 3)), ["toe"], feet=["toe"], body=[], name=name
        )
        for name in ("jump", "jump", "jump_2", "jump")
    ]
    trials = [Trial(one, (Path("jump.csv"),)) for one in recordings]
    name_apart(trials)
    names = [one.recording.name for one in trials]
    assert names == ["jump", "jump_3", "jump_2", "jump_4"]


def test_what_is_true_of_several_files_is_told_once():
    """Only the files before the notes differ; a note without a file stays as it is."""
    one = Recording.from_arrays(
        [0.0, 0.01], np.zeros((2, 1, 3)), ["toe"], feet=["toe"], body=[], name="jump"
    )
    notes = ("feet guessed: toe", "one of its own")
    trials = [
        Trial(one, (Path(name),), notes=tuple(f"{name}: {note}" for note in notes[:n]))
        for name, n in (("a.c3d", 1), ("b.c3d", 2), ("c.c3d", 1))
    ]
    assert _notes_of(trials) == [
        "a.c3d and 2 other files: feet guessed: toe",
        "b.c3d: one of its own",
    ]
    assert _notes_of([Trial(one, (Path("d.c3d"),), notes=("as it is",))]) == [
        "as it is"
    ]


def test_files_that_raise_one_question_are_asked_about_once():
    """What speaks for it differs from file to file."""
    one = Recording.from_arrays(
        [0.0, 0.01], np.zeros((2, 1, 3)), ["toe"], feet=["toe"], body=[], name="jump"
    )

    def trial(name, other, pull):
        why = Message("recordings.rate_pulls_too_much", {"pull": pull})
        guess = Guess("240", why, is_sure=False, other=other)
        asked = listing.question("input.rate_hz", guess)
        return Trial(one, (Path(name),), asked=asked)

    notes = _notes_of(
        [trial("a", "120", 3.9), trial("b", "480", 0.2), trial("c", "120", 3.5)]
    )
    assert len(notes) == 2
    assert notes[0].startswith("a and 1 other file: input.rate_hz: 240 or 120?")
    assert "3.9 g" in notes[0]
    assert notes[1].startswith("b: input.rate_hz: 240 or 480?")


BODY = ("hip1", "hip2", "hip3")


def with_a_plate(folder, name, *, seed, late_s=0.0):
    """Write hops of one foot on a force plate; return when the foot touches, s.

    The plate's forces are late by `late_s`, s.
    """
    time, positions = hopping(seed, n_frames=500)
    names = [MARKERS.index(one) for one in (*BODY, "toe1", "toe2")]
    markers = tuple(MARKERS[one] for one in names)
    toe = positions[:, names[3]].mean(axis=0)
    middle_m = CORNERS[0].mean(axis=0) / 1000
    place = positions[:, names] - toe * [1.0, 1.0, 0.0]
    place[:, :, :2] += middle_m[:2]
    raw = RawRecording(markers, time, 1000 * place, 100.0, "mm")
    recording = Recording.from_arrays(
        time, place[:, :4], markers[:4], feet=["toe1"], body=BODY
    )
    touches = hd.contacts(recording).found["contact_s"].to_numpy()
    at = np.arange(10 * len(time)) / 1000.0
    since = at[:, None] - touches - late_s
    since = np.where(since >= 0, since, np.inf).min(axis=1)
    rises = np.minimum(since / 0.03, 1.0)
    bears = np.where(since < 0.2, 800.0 * rises, 0.0)
    noise = np.random.default_rng(seed).normal(0, 0.5, len(at))
    force = np.stack([0 * at, 0 * at, bears + noise], axis=1)
    where = np.tile(CORNERS[0].mean(axis=0), (len(at), 1))
    stance = Stance(force, where, 0 * at)
    write_plates(folder / name, raw, [stance], PlateFile(2))
    return touches


def test_contacts_are_compared_with_the_plates_of_the_file(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    touches = with_a_plate(tmp_path, "plate.c3d", seed=1)
    given = ["contacts", "plate.c3d", "--feet", "toe1", "--out", "a.csv"]
    assert main([*given, "--html", "a.html"]) == 0
    told = f"{len(touches)} contacts load a force plate of the file"
    said = capsys.readouterr().out
    assert told in said
    assert "without a contact" not in said
    # A number and its unit stay together.
    page = (tmp_path / "a.html").read_text("utf-8").replace("\u00a0", " ")
    assert told in page
    table = pd.read_csv("a.csv")
    late_ms = 1000 * (table["contact_s"] - table["plate_s"])
    assert f"{late_ms.median():+.1f} ms" in page
    assert "contact after plate (ms)" in page
    assert "plate.c3d: " not in page  # a single file is named once
    for late in late_ms:
        assert f"{late:.1f}</td>" in page
    assert set(table["plate"]) == {"plate 1"}
    late_s = table["contact_s"] - table["plate_s"]
    assert late_s.abs().max() < 0.004
    assert (table["plate_se_s"] > 0).all()
    # A recording that was read is compared with its file as well, for the part it has.
    found = hd.contacts(hd.read("plate.c3d").between(0, touches[1]), feet=["toe1"])
    assert set(found.table["plate"]) == {"plate 1"}
    assert not [one for one in found.remarks if "without a contact" in str(one)]


def test_plates_that_are_loaded_without_a_contact_are_told(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    touches = with_a_plate(tmp_path, "late.c3d", seed=1, late_s=0.1)
    assert main(["contacts", "late.c3d", "--feet", "toe1", "--out", "a.csv"]) == 0
    told = f"loaded {len(touches)} times without a contact within 50 ms"
    assert told in capsys.readouterr().out
    assert pd.read_csv("a.csv")["plate_s"].isna().all()


def test_plates_of_files_that_are_joined_are_compared_on_one_clock(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    n_landings = [
        len(with_a_plate(tmp_path, f"{name}.c3d", seed=seed))
        for seed, name in enumerate("ab", start=1)
    ]
    (tmp_path / "study.yaml").write_text(
        "study: both\n"
        "recordings:\n  - {name: day, file: [a.c3d, b.c3d]}\n"
        "markers: {body: [hip1, hip2, hip3], feet: [toe1, toe2]}\n"
    )
    assert main(["contacts", "study.yaml", "--out", "day.csv"]) == 0
    table = pd.read_csv("day.csv").dropna(subset=["plate_s"])
    assert len(table) == sum(n_landings)
    assert (table["contact_s"] - table["plate_s"]).abs().max() < 0.004
    assert table["contact_s"].max() > 5.0


def test_a_file_without_plates_has_empty_columns(recording):
    assert main(["contacts", str(recording), "--out", "none.csv"]) == 0
    assert pd.read_csv("none.csv")["plate_s"].isna().all()


def told_of(notes):
    """Return a file's notes in words, one of a kind."""
    positions = np.zeros((3, 1, 3))
    time = 0.01 * np.arange(3)
    made = Recording.from_arrays(time, positions, ["a"], feet=["a"], body=[])
    return [str(note) for note in one_of_a_kind(made, notes)]


def test_notes_of_a_kind_are_told_as_one():
    unseen = [
        Message("recordings.unseen", {"marker": name, "percent": 30.0})
        for name in ("toe", "heel")
    ]
    pairs = [
        Message(
            "recordings.feet_at_one_distance",
            {"one": "a", "other": name, "apart_mm": 2.0},
        )
        for name in ("b", "c")
    ]
    notes = [
        Message("recordings.at", {"place": "x", "remark": one})
        for one in (*unseen, *pairs)
    ]
    told = told_of(notes)
    assert len(told) == 2
    assert "toe (30 %), heel (30 %)" in told[0]
    assert "'a' and 'b' (2.0 mm), 'a' and 'c' (2.0 mm)" in told[1]
    # One alone keeps its own words, and another kind is not touched.
    other = Message("recordings.as_read", {"text": "a clock that jitters"})
    alone = told_of([notes[2], other])
    assert sorted(alone) == sorted([str(notes[2]), "a clock that jitters"])


def test_a_marker_unseen_for_long_is_told_of_once(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    positions = hopping(1, n_frames=500)[1]
    positions[100:280, MARKERS.index("toe1")] = np.nan
    file = export(tmp_path, positions)
    main(["contacts", str(file), "--feet", "toe1", "toe2", "toe3"])
    out = capsys.readouterr().out
    assert len(re.findall(r"toe1 \(\d+ %\)", out)) == 1
    assert "markers that many frames do not show: toe1" in out
