"""What `inspect`, `init` and `check` say of force plates, events and analog channels."""

import re
import warnings

import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping
from plate_files import PlateFile, Stance, write_plates
from written_files import write_c3d

from hopdata.__main__ import main
from hopdata.config.loading import load_config
from hopdata.inspecting.devices import devices_of, lines_of
from hopdata.recording import Event
from hopdata.recordings.raw import RawRecording

RATE_HZ = 100.0
PER_FRAME = 10
ONSETS_S = (2.0, 5.5, 9.25)
EVENTS = (Event("Left Foot Strike", 1.25), Event("STRT", 2.5))


def hopper(**given):
    time, positions = hopping(1)
    return RawRecording(MARKERS, time, 1000 * positions, RATE_HZ, "mm", **given)


def stance(n, place_mm, share):
    time = np.arange(n) / (RATE_HZ * PER_FRAME)
    load = np.random.default_rng(6).normal(0, 0.4, n)
    for onset in ONSETS_S:
        on = (time >= onset) & (time < onset + 0.3)
        load[on] += np.minimum(40_000 * (time[on] - onset), 600) * share
    force = np.column_stack([0 * load, 0 * load, load])
    return Stance(force, np.tile(place_mm, (n, 1)), np.zeros(n))


def write(path, how=None, **given):
    raw = hopper(**given)
    n = len(raw.time) * PER_FRAME
    stances = [stance(n, (150.0, 250.0, 0.0), 1.0), stance(n, (700.0, 300.0, 3.0), 0.0)]
    write_plates(path, raw, stances, how or PlateFile(2))
    return path


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def plain(text):
    return re.sub(r"\s+", " ", text)


@pytest.mark.parametrize("kind", [2, 3])
def test_inspect_lists_plates_events_and_channels(folder, capsys, kind):
    write(folder / "jump.c3d", PlateFile(kind), events=EVENTS)
    assert main(["inspect", "jump.c3d"]) == 0
    out = plain(capsys.readouterr().out)
    last = {2: "f", 3: "h"}[kind]
    for part in (
        f"plate 1: type {kind}, 0.40 x 0.60 m, x 0.00 to 0.40 m, y 0.00 to 0.60 m, z 0.000 m",
        f"a1 to {last}1 (",
        "at 1000 Hz, up to 60",
        "3 onsets to within",
        "2.000, 5.500, 9.250 s",
        f"plate 2: type {kind}, 0.60 x 0.50 m",
        "never loaded, or all the time",
        "events 2: Left Foot Strike 1.250 s, STRT 2.500 s",
        f"analog {2 * len('abcdefgh'[: 6 + 2 * (kind == 3)])} channels at 1000 Hz: a1 (N)",
    ):
        assert part in out, part


def test_inspect_says_what_is_wrong_with_a_plate(folder, capsys):
    write(folder / "volts.c3d", PlateFile(2, units=["V"] * 6))
    main(["inspect", "volts.c3d", "--html", "page.html"])
    out = plain(capsys.readouterr().out)
    assert "force plate 1 is not used" in out
    assert "found 'V'; its calibration matrix belongs to type 4" in out
    assert "12 channels at 1000 Hz: a1 (V)" in out
    assert "force plate 1 is not used" in (folder / "page.html").read_text()


def test_a_file_without_devices_says_nothing_of_them(folder, capsys):
    write_c3d(folder / "plain.c3d", hopper())
    main(["inspect", "plain.c3d", "--html", "page.html"])
    out = capsys.readouterr().out
    page = (folder / "page.html").read_text()
    for word in ("plate", "analog", "events"):
        assert word not in out
    for title in ("Force plates", "Events"):
        assert title not in page


def test_the_page_has_tables_of_them(folder):
    write(folder / "jump.c3d", events=EVENTS)
    main(["inspect", "jump.c3d", "--html", "page.html"])
    page = (folder / "page.html").read_text()
    for part in ("Force plates", "plate 1", "a1 to f1", "Left Foot Strike", "1.250"):
        assert part in page


def test_init_says_which_are_compared(folder):
    write(folder / "jump.c3d", events=EVENTS)
    main(["init", "jump.c3d", "--out", "jump.yaml"])
    text = plain((folder / "jump.yaml").read_text().replace("#", ""))
    assert "Force plate 1 of the file (0.40 x 0.60 m; 3 onsets to within" in text
    assert "the report compares its contacts, no key is needed" in text
    assert "Events of the file (Left Foot Strike, STRT): the report compares" in text
    load_config("jump.yaml")
    # Of several recordings it says whose plate it is.
    write(folder / "hop.c3d", events=())
    main(["init", "jump.c3d", "hop.c3d", "--out", "both.yaml"])
    text = plain((folder / "both.yaml").read_text().replace("#", ""))
    assert "Force plate 1 of jump.c3d (0.40 x 0.60 m" in text
    assert "Events of jump.c3d (Left Foot Strike" in text


def test_init_proposes_events_whose_feet_are_not_known(folder):
    write_c3d(folder / "marked.c3d", hopper(events=(Event("down", 1.0),)))
    main(["init", "marked.c3d", "--out", "marked.yaml"])
    text = plain((folder / "marked.yaml").read_text().replace("#", ""))
    found = re.search(r"such a block: (contacts: \{.*\]\})", text)
    assert found, text
    config = (folder / "marked.yaml").read_text()
    asked = config.replace("file: marked.c3d}", f"file: marked.c3d, {found[1]}}}", 1)
    (folder / "asked.yaml").write_text(asked)
    loaded = load_config("asked.yaml")
    (column,) = loaded["recordings"][0]["contacts"]["columns"]
    assert column["name"] == "down"
    assert column["feet"] == loaded["markers"]["feet"]


def test_check_describes_the_plates(folder, capsys):
    write(folder / "jump.c3d", PlateFile(2, origin_sign=-1.0))
    main(["init", "jump.c3d", "--out", "jump.yaml"])
    capsys.readouterr()
    main(["check", "jump.yaml"])
    out = plain(capsys.readouterr().out)
    assert "plate 1: type 2, 0.40 x 0.60 m" in out
    assert "3 onsets to within" in out
    assert "force plate 1: ORIGIN points down" in out


@pytest.mark.parametrize("kind", [1, 2, 3, 4])
def test_damaged_plates_are_told_or_read(folder, kind):
    """Bytes of the header, the parameters and the samples at random."""
    positions = 1000 * hopping(1)[1][:30]
    time = np.arange(30) / RATE_HZ
    short = RawRecording(MARKERS, time, positions, RATE_HZ, "mm")
    stances = [stance(300, (150.0, 250.0, 0.0), 1.0)] * 2
    write_plates(folder / "sound.c3d", short, stances, PlateFile(kind))
    sound = (folder / "sound.c3d").read_bytes()
    n_read = 0
    n_told = 0
    for seed in range(60):
        rng = np.random.default_rng([kind, seed])
        damaged = bytearray(sound)
        for at in rng.integers(0, min(len(sound), 4096), 3).tolist():
            # An infinity, a signalling NaN, zeros or anything.
            choices = (
                b"\x00\x00\x80\x7f",
                b"\x01\x00\x80\x7f",
                b"\0\0\0\0",
                rng.bytes(4),
            )
            damaged[at : at + 4] = choices[rng.integers(4)]
        (folder / "damaged.c3d").write_bytes(bytes(damaged))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = devices_of(folder / "damaged.c3d", up="z", unit="mm")
            lines_of(found)
        n_read += len(found.plates) == 2
        n_told += bool(found.refused)
    assert n_read > 20
    assert n_told > 2
