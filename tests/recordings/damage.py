"""Small sound files of every format, and seeded ways to damage them."""

import io
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import vendor_files
from bids_files import NAME, write_bids
from csv_files import motive, nexus
from keypoint_files import (
    anipose,
    deeplabcut,
    pandas_blocks,
    pandas_rows,
    table,
)
from keypoint_files import (
    columns as keypoint_columns,
)
from mat_files import qtm_struct, write_mat5, write_mat73
from qtm_files import NAMES, columns, data_rows, qtm_text, standing
from trc_files import trc_text
from written_files import write_c3d

from hopdata.errors import RecordingError
from hopdata.recording import Event, Recording
from hopdata.recordings.external import read_force_signals
from hopdata.recordings.importing import import_recording
from hopdata.recordings.plausibility import check_plausible
from hopdata.recordings.raw import RawRecording
from hopdata.recordings.readers.hdf5 import write_recording
from hopdata.seal import seal_for

N_FRAMES = 24
TEXTS = (".tsv", ".txt", ".trc", ".csv", ".mot", ".json", ".bvh", ".mvnx")
PACKED = (".zip", ".xlsx")
EVENTS = (("strike", 0.05), ("toe off", 0.12))
FORCE = "ground_force_vy"
MARKERS = {"body": list(NAMES[:3]), "feet": list(NAMES[3:])}
# Words that replace fields of text files.
WORDS = (
    *(
        "",
        "NULL",
        "NaN",
        "inf",
        "-1",
        "0",
        "1e300",
        "-1e-320",
        "99999999999999999999",
        "1,5",
    ),
    *(
        "4294967295",
        "65536",
        "2147483648",
        "0x10",
        "1_000",
        "\u0663",
        "True",
        '"',
        "EXT",
        "\0",
    ),
)
NUMBERS = (
    0,
    1,
    2,
    127,
    128,
    255,
    32767,
    32768,
    65535,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**63,
    2**64 - 1,
)


def corpus():
    """Return sound files: the key is a name with the format's suffix, the value the bytes."""
    with TemporaryDirectory() as folder:
        return {**_texts(), **_binaries(Path(folder))}


def _texts():
    positions = standing(N_FRAMES)
    positions[3:5, 1] = 0.0
    event = {"EVENT": "strike\t6\t0.05000\r\nEVENT\ttoe off\t13\t0.12000"}
    bare = ["\t".join(["Time", *(c[:-2] + c[-1] for c in columns())])]
    bare += [row.split("\t", 1)[1] for row in data_rows(positions)]
    texts = {
        "whole.tsv": qtm_text(positions, header=event),
        "no_columns.tsv": qtm_text(positions, column_row=False, line_end="\n"),
        "no_counters.tsv": qtm_text(positions, counters=False),
        "external.tsv": qtm_text(positions, frequency="EXT"),
        "bare.txt": "\n".join(bare) + "\n",
        "motive.csv": motive(positions, NAMES),
        "nexus.csv": nexus(positions, NAMES),
        "anipose.csv": anipose(positions, NAMES, np.full((N_FRAMES, len(NAMES)), 0.9)),
        "deeplabcut.csv": deeplabcut(positions, NAMES),
        "forces.mot": _storage(),
        "mm.trc": trc_text(positions, NAMES),
        "m.trc": trc_text(positions / 1000, NAMES, unit="m", blank=False, tab="\t"),
    }
    return {name: text.encode() for name, text in texts.items()} | _of_vendors()


def _of_vendors():
    """Return files of further programs."""
    positions = standing(N_FRAMES)
    gappy = positions.copy()
    gappy[3:5, 1] = np.nan
    series = vendor_files.ktk_series(gappy / 1000, NAMES, events=EVENTS)
    points = (("a", "b", "c"), positions[:, :3] + 9)
    ends = {3: (0.0, 1.0, 2.0)}
    table = vendor_files.table_of(gappy, NAMES)
    return {
        "joints.bvh": vendor_files.bvh(positions / 10, NAMES, ends=ends),
        "tracks.trb": vendor_files.trb(gappy, NAMES),
        "segments.mvnx": vendor_files.mvnx(positions / 1000, NAMES),
        "series.ktk.zip": vendor_files.ktk({"Markers": series, "Note": "hop"}),
        "rows_of_sleap.csv": vendor_files.sleap_csv(gappy, NAMES),
        "dflow.txt": vendor_files.dflow(gappy / 1000, NAMES),
        "rotations.c3d": vendor_files.theia(gappy, NAMES),
        "points_and_rotations.c3d": vendor_files.theia(gappy, NAMES, points=points),
        "sheets.xlsx": vendor_files.xlsx({"info": [["hop"]], "data": table}),
    }


def _storage():
    """Return OpenSim's file of forces under a plate, in a column named like `FORCE`."""
    head = [
        "forces",
        "version=1",
        f"nRows={N_FRAMES}",
        "nColumns=2",
        "inDegrees=yes",
        "endheader",
    ]
    rows = [f"{k / 1000:.4f}\t{700 * (k % 9):.3f}" for k in range(N_FRAMES)]
    return "\n".join([*head, f"time\t{FORCE}", *rows]) + "\n"


def placed(folder, name, data):
    """Write a damaged file and its companions; return the path to read."""
    if name.startswith(NAME):
        path = write_bids(folder, standing(N_FRAMES), NAMES)
        (folder / name).write_bytes(data)
        return path
    path = folder / f"damaged{name[name.index('.') :]}"
    path.write_bytes(data)
    return path


def _binaries(folder):
    positions = standing(N_FRAMES)
    positions[3:5, 1] = np.nan
    time = np.arange(N_FRAMES) / 100
    events = tuple(Event(*event) for event in EVENTS)
    raw = RawRecording(
        NAMES, time, positions, 100.0, "mm", events=events, stated_up="z"
    )
    for processor in ("Intel", "DEC", "MIPS"):
        write_c3d(folder / f"{processor.lower()}.c3d", raw, processor=processor)
    write_c3d(folder / "whole_numbers.c3d", raw, whole_numbers=True)
    struct = qtm_struct(positions, NAMES, events=EVENTS)
    write_mat5(folder / "plain.mat", struct)
    write_mat5(folder / "compressed.mat", struct, compressed=True)
    write_mat73(folder / "hdf5.mat", struct)
    roles = ("body",) * 3 + ("foot",) * 2
    heads, values = keypoint_columns(NAMES, score=""), table(positions)
    pandas_rows(folder / "rows.h5", heads, values)
    pandas_blocks(folder / "blocks.h5", heads, values)
    vendor_files.sleap_analysis(folder / "sleap.h5", positions, NAMES)
    write_bids(folder, standing(N_FRAMES), NAMES)
    own = Recording("trial", time, positions / 1000, NAMES, roles, 100.0, events=events)
    write_recording(folder / "own.h5", own)
    sealed = (folder / "own.h5").read_bytes()
    # Without its checksum, or no damage would reach the library.
    (folder / "own.h5").write_bytes(sealed[: -len(seal_for(folder / "own.h5"))])
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def damaged(data, rng, *, text):
    """Return the data after one to three seeded damages in succession."""
    kinds = ANYWHERE + (IN_TEXT if text else IN_NUMBERS)
    for _ in range(rng.integers(1, 4)):
        data = kinds[rng.integers(len(kinds))](data, rng)
    return data


def damaged_inside(data, rng):
    """Return packed data with one member damaged before it was packed."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = list(members)[rng.integers(len(members))]
    members[name] = damaged(members[name], rng, text=True)
    return vendor_files.zipped(members)


def _place(data, rng):
    """Return the place of a byte, half the time among the first 2,000, where headers are."""
    most = len(data) if rng.random() < 0.5 else min(len(data), 2000)
    return int(rng.integers(most)) if most else 0


def flip(data, rng):
    changed = bytearray(data)
    for _ in range(rng.integers(1, 9)):
        if changed:
            changed[_place(data, rng)] = rng.integers(256)
    return bytes(changed)


def truncate(data, rng):
    return data[: _place(data, rng)]


def extend(data, rng):
    more = rng.bytes(int(rng.integers(1, 600)))
    return data + (more if rng.random() < 0.5 else b"\0" * len(more))


def delete(data, rng):
    at = _place(data, rng)
    return data[:at] + data[at + int(rng.integers(1, 64)) :]


def repeat(data, rng):
    at, length = _place(data, rng), int(rng.integers(1, 64))
    return data[: at + length] + data[at:]


def lie(data, rng):
    """Write an integer or float of any width at any place."""
    at, width = _place(data, rng), int(rng.choice([1, 2, 4, 8]))
    order = "little" if rng.random() < 0.7 else "big"
    number = (NUMBERS[rng.integers(len(NUMBERS))] % 256**width).to_bytes(width, order)
    if rng.random() < 0.3:
        special = rng.choice([np.nan, np.inf, -1.0, 1e38, 0.0])
        number = (
            np.float32(special).tobytes()
            if width < 8
            else np.float64(special).tobytes()
        )
    return data[:at] + number + data[at + len(number) :]


def lie_in_words(data, rng):
    """Replace one field of one line by a word."""
    lines = data.split(b"\n")
    i = int(rng.integers(min(len(lines), 14) if rng.random() < 0.6 else len(lines)))
    mark = max((b"\t", b","), key=data.count)
    fields = lines[i].split(mark)
    fields[rng.integers(len(fields))] = WORDS[rng.integers(len(WORDS))].encode()
    return b"\n".join([*lines[:i], mark.join(fields), *lines[i + 1 :]])


def move_line(data, rng):
    lines = data.split(b"\n")
    line = lines.pop(int(rng.integers(len(lines))))
    for _ in range(rng.integers(3)):  # removed, moved, or duplicated
        lines.insert(int(rng.integers(len(lines) + 1)), line)
    return b"\n".join(lines)


ANYWHERE = (flip, truncate, extend, delete, repeat)
IN_TEXT = (lie_in_words, lie_in_words, lie_in_words, move_line, move_line)
IN_NUMBERS = (lie, lie, lie, lie)


def read(path):
    """Return what a user sees: the checked recording, or the message of the error.

    Other exceptions propagate; an impossible recording is an AssertionError.
    """
    begin = path.read_text("latin-1")
    stateless = (
        "EXT" in begin[:400],
        "scorer" in begin[:40],
        "ncams" in begin,
        "pandas" in begin,
        "frame_idx" in begin[:400],
        "track_occupancy" in begin,
    )
    rate_hz = 100.0 if any(stateless) else None
    try:
        if path.suffix == ".mot":
            return _forces(path)
        recording, _ = import_recording(
            path, name="trial", markers=MARKERS, rate_hz=rate_hz
        )
        check_plausible(recording)
    except RecordingError as error:
        message = str(error)
        assert message.startswith(str(path.parent)), f"no file named: {message}"
        assert "\n" not in message, f"more than one line: {message}"
        assert "expected" in message, f"no 'expected' in the message: {message}"
        assert "found" in message, f"no 'found' in the message: {message}"
        return message
    assert recording.positions.shape == (len(recording.time), len(recording.markers), 3)
    assert np.isfinite(recording.time).all()
    assert not np.isinf(recording.positions).any()
    assert recording.rate_hz > 0
    return recording


def _forces(path):
    column = {
        "columns": [{"name": FORCE, "feet": ["toe"]}],
        "time_column": None,
        "rate_hz": None,
    }
    options = {"file": path, "unit": "N", "inverted": False, "offset_s": 0.0, **column}
    (signal,) = read_force_signals(options, feet=("toe",))
    assert np.isfinite(signal.time).all()
    return signal


def case(sound, names, seed, number):
    """Return name and bytes of damaged file `number`: sound files in turn, seed by seed.

    The seeds are told by the name, so a further sound file leaves the damage of the
    others as it was.
    """
    turn, place = divmod(number, len(names))
    name = names[place]
    seeds = np.random.SeedSequence([seed, turn, *name.encode()])
    rng = np.random.Generator(np.random.PCG64(seeds))
    if name.endswith(PACKED) and rng.random() < 0.7:
        return name, damaged_inside(sound[name], rng)
    return name, damaged(sound[name], rng, text=Path(name).suffix in TEXTS)
