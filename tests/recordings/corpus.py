"""A standing corpus: small files, each with a habit of a program or a lab, and what they give.

    python tests/recordings/corpus.py --write

makes `corpus.csv` again, one row for each file. Its first columns are the truth: whether a
careful person would read the file (`file`), which axis points up, the unit (a stated cm or
inch is turned to mm as it is read), the rate, the markers of body and feet, and how many
landings there are. The columns `found_...` are what
the library makes of the file:

- `found_file`: `read`, or `refused:` with the code of the message or what it says of the
  fault.
- `found_positions`: `right` if all are where they should be to 0.1 mm and the same are
  missing, else how many are not.
- `found_up`, `found_unit`, `found_rate`: `right_sure`; `right_asked` or `wrong_asked` if the
  library asks, since its guess is not sure; `wrong_sure`, which must not be.
- `found_body`, `found_feet`: the same for the markers; `asked` if it could not guess any.
- `found_landings`: in how many descents of the body all feet touch down, if the truth is
  given.

`test_corpus.py` compares this table with what the library makes of the files today. A
change of a reader, guard or guess that moves a row shows it there; if the row is better or
the change is meant, the table is written again, and the difference is reviewed as any code.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE / "quality")]

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
import vendor_files as vendors  # noqa: E402
from bids_files import write_bids  # noqa: E402
from csv_files import cells, motive, nexus  # noqa: E402
from habits import decimal_commas  # noqa: E402
from keypoint_files import (  # noqa: E402
    anipose,
    columns,
    deeplabcut,
    pandas_blocks,
    pandas_rows,
    table,
)
from made_up_hopper import BODY, FEET, hopping  # noqa: E402
from made_up_jumps import STYLES, jumping  # noqa: E402
from made_up_runner import NAMES as PELVIS_NAMES  # noqa: E402
from made_up_runner import RATE_HZ as RUN_HZ  # noqa: E402
from made_up_runner import runner  # noqa: E402
from mat_files import qtm_struct, write_mat5, write_mat73  # noqa: E402
from qtm_files import qtm_text  # noqa: E402
from trc_files import trc_text  # noqa: E402

import hopdata as hd  # noqa: E402
from hopdata.errors import HopdataError, RecordingError  # noqa: E402
from hopdata.recording import Recording  # noqa: E402
from hopdata.recordings.axes import rotate_up  # noqa: E402
from hopdata.recordings.importing import import_recording  # noqa: E402
from hopdata.recordings.quality.free_fall import UNITS_IN_M  # noqa: E402
from hopdata.recordings.quality.inspection import inspect_recording  # noqa: E402
from hopdata.recordings.raw import RateUnknownError  # noqa: E402
from hopdata.recordings.readers.formats import read_raw  # noqa: E402
from hopdata.recordings.readers.hdf5 import write_recording  # noqa: E402

TABLE = HERE / "corpus.csv"
READ = "read"


# The animals.


@dataclass(frozen=True)
class Animal:
    """A made-up animal: positions (N, M, 3), m, z up, and the truth of it."""

    names: tuple[str, ...]
    positions: np.ndarray
    rate_hz: float
    body: tuple[str, ...]
    feet: tuple[str, ...]
    landings: int | None
    # Markers that move with the body, and may be taken for it.
    trunk: tuple[str, ...] = ()

    def named(self, *names):
        """Return the animal with other names for its markers."""
        new = dict(zip(self.names, names, strict=True))
        return replace(
            self,
            names=names,
            body=tuple(new[name] for name in self.body),
            feet=tuple(new[name] for name in self.feet),
            trunk=tuple(new[name] for name in self.trunk),
        )

    def with_more(self, names, positions):
        """Return the animal with further markers, which have no role."""
        every = np.concatenate([self.positions, positions], axis=1)
        return replace(self, names=(*self.names, *names), positions=every)


@cache
def hopper(seed=1, n_frames=600, rate_hz=100.0, gaps=True):
    """Return a hopper of three feet beside a post, with a few frames unseen."""
    options = {"n_frames": n_frames, "rate_hz": rate_hz}
    _, positions = hopping(seed, **options)
    _, exact = hopping(seed, **options, noise_m=0.0)
    in_air = exact[:, 3:6, 2].mean(axis=1) > 1e-9
    landings = int((np.diff(in_air.astype(int)) == -1).sum())
    if gaps:
        positions[40:44, 1] = np.nan
        positions[200:203, 4] = np.nan
    # As files print them, to 0.01 mm.
    positions = np.round(positions, 5)
    body = tuple(f"hip{k + 1}" for k in range(len(BODY)))
    feet = tuple(f"toe{k + 1}" for k in range(len(FEET)))
    return Animal((*body, *feet, "post"), positions, rate_hz, body, feet, landings)


@cache
def jumper(style="plug-in gait", seed=1, jumps=2, rate_hz=100.0):
    """Return a person who jumps, with the names of a marker set."""
    names = STYLES[style]
    positions = np.round(jumping(seed, jumps=jumps, rate_hz=rate_hz), 5)
    feet = (*names[4:9], *names[10:15])
    return Animal(names, positions, rate_hz, names[:4], feet, jumps, names[16:])


@cache
def stander(style="plug-in gait"):
    """Return a person who stands: a static trial, from which no landing comes."""
    person = jumper(style)
    rng = np.random.default_rng(np.random.SeedSequence(7))
    still = np.repeat(person.positions[:1], 200, axis=0)
    still = np.round(still + rng.normal(0, 3e-4, still.shape), 5)
    return replace(person, positions=still, landings=0)


@cache
def walker(style="opensim", seed=1, on_treadmill=True, rate_hz=100.0, seconds=6.0):
    """Return a person who walks: one foot is always down, and nothing falls."""
    names = STYLES[style]
    base = jumper(style).positions[0]
    rng = np.random.default_rng(np.random.SeedSequence([11, seed]))
    time = np.arange(int(seconds * rate_hz)) / rate_hz
    positions = np.repeat(base[None], len(time), axis=0)
    phase = 2 * np.pi * 0.9 * time
    positions[:, :, 2] += 0.02 * np.cos(2 * phase)[:, None]
    for first, shift in ((4, 0.0), (10, np.pi)):
        swing = np.sin(phase + shift)
        lift = 0.08 * np.maximum(swing, 0.0) ** 2
        forward = -0.3 * np.cos(phase + shift)
        for marker in range(first, first + 6):
            positions[:, marker, 0] = base[marker, 0] + forward
            positions[:, marker, 2] = base[marker, 2] + lift
    if not on_treadmill:
        positions[:, :, 0] += 1.2 * time[:, None]
    positions += rng.normal(0, 4e-4, positions.shape)
    feet = (*names[4:9], *names[10:15])
    positions = np.round(positions, 5)
    return Animal(names, positions, rate_hz, names[:4], feet, None, names[16:])


@cache
def running(seed=1):
    """Return a runner with a soft pelvis, and a marker on each foot."""
    pelvis, feet = runner(seed, skin_m=3e-3, wobble_m=2e-3, n_frames=900)
    names = (*PELVIS_NAMES, "R.Heel", "L.Heel")
    positions = np.round(np.concatenate([pelvis, feet], axis=1), 5)
    return Animal(names, positions, RUN_HZ, names[:4], names[4:], None)


@cache
def turned_person(kind, style="plug-in gait"):
    """Return a person who is not upright: ``lying`` on the back, or in a ``handstand``."""
    person = stander(style)
    x, y, z = np.moveaxis(person.positions, 2, 0)
    if kind == "lying":
        places = np.stack([z, y, x + 0.2], axis=2)
    else:
        places = np.stack([x, -y, 1.9 - z], axis=2)
    rng = np.random.default_rng(np.random.SeedSequence(13))
    slow = np.cumsum(rng.normal(0, 1e-3, (len(places), 1, 3)), axis=0)
    return replace(person, positions=np.round(places + slow, 5), landings=0)


@cache
def reaching():
    """Return an arm that reaches from a chair: no feet, no falls, a trunk that is still."""
    names = ("C7", "STRN", "T10", "RSHO", "RELB", "RWRA", "RFIN")
    base = np.array([[0, 0, 1.1], [0.15, 0, 1.0], [0, 0, 0.9], [0.05, -0.2, 1.05],
                     [0.1, -0.3, 0.8], [0.3, -0.3, 0.75], [0.4, -0.3, 0.75]])  # fmt: skip
    time = np.arange(500) / 100
    places = np.repeat(base[None], len(time), axis=0)
    reach = 0.5 - 0.5 * np.cos(2 * np.pi * 0.4 * time)
    for marker, share in ((4, 0.4), (5, 0.9), (6, 1.0)):
        places[:, marker, 0] += 0.3 * share * reach
        places[:, marker, 2] += 0.2 * share * reach
    rng = np.random.default_rng(np.random.SeedSequence(17))
    places += rng.normal(0, 3e-4, places.shape)
    return Animal(names, np.round(places, 5), 100.0, names[:3], (), None)


def in_file(animal, up="z", unit="mm"):
    """Return the positions along the axes of a file, in its unit."""
    turned = animal.positions @ np.linalg.inv(rotate_up(np.eye(3), up))
    return turned / UNITS_IN_M[unit]


def as_read(unit):
    """Return the unit to which a reader turns a stated one."""
    return unit if unit in ("mm", "m") else "mm"


# The cases.


@dataclass(frozen=True)
class Case:
    """A file and its truth.

    `content` is bytes, text, or a function that writes the file at a path and may return
    another path to read. `file` is ``read``, or why a careful person would refuse it.
    """

    program: str
    habit: str
    suffix: str
    content: bytes | str | Callable
    animal: Animal
    up: str = "z"
    unit: str = "mm"
    file: str = READ
    given_hz: float | None = None
    has_landings: bool = False
    has_roles: bool = True
    name: str = field(default="monday")

    def write(self, folder):
        """Write the file, and return the path to read."""
        path = folder / f"{self.name}{self.suffix}"
        if isinstance(self.content, str | bytes):
            data = self.content
            path.write_bytes(data.encode() if isinstance(data, str) else data)
            return path
        return self.content(path) or path


def cases():
    """Return all cases, program by program."""
    makers = (
        _c3d_of_programs,
        _motions,
        _c3d_of_writers,
        _c3d_with_rotations,
        _trc_of_programs,
        _trc_of_people,
        _qtm,
        _motive,
        _nexus,
        _tables,
        _keypoints,
        _sleap,
        _mat_and_bids,
        _skeletons,
        _further_programs,
        _workbooks,
        _no_recordings,
    )
    every = [case for maker in makers for case in maker()]
    keys = [(case.program, case.habit) for case in every]
    assert len(set(keys)) == len(keys), "two cases of one program and habit"
    return every


def _c3d(
    program, habit, animal, *, up="z", unit="mm", truth=None, file=READ, **options
):
    """Return a case of C3D; `options` are those of `vendor_files.c3d`.

    `truth` holds fields of the case that differ from what is written.
    """
    places = in_file(animal, up, unit)
    options = {"unit": unit, "rate": animal.rate_hz, **options}
    if options["unit"] == "inch":
        options["unit"] = "in"
    data = vendors.c3d(places, animal.names, **options)
    given = {"up": up, "unit": as_read(unit), "file": file, **(truth or {})}
    return Case(program, habit, ".c3d", data, animal, **given)


def screen(x, y):
    """Return the parameters by which a file says how its axes lie on a screen."""
    return {"X_SCREEN": [x], "Y_SCREEN": [y]}


def _c3d_of_programs():
    hop, jump = hopper(), jumper()
    maker = {"MANUFACTURER": {"COMPANY": ["Vicon"], "SOFTWARE": ["Vicon Nexus"]}}
    subject = jump.named(*(f"Anna:{name}" for name in jump.names))
    yield _c3d("Vicon Nexus", "a subject before each name", subject, groups=maker,
               truth={"has_landings": True})  # fmt: skip
    outputs = ("LHipAngles", "RKneeMoment", "LAnklePower", "CentreOfMass", "*113")
    rng = np.random.default_rng(3)
    more = rng.normal(0.3, 0.2, (len(jump.positions), len(outputs), 3))
    lists = {"POINT": {"ANGLES": ["LHipAngles"], "POWERS": ["LAnklePower"]}}
    yield _c3d("Vicon Nexus", "model outputs beside markers",
               jump.with_more(outputs, more), groups=lists)  # fmt: skip
    yield _c3d("Vicon Workstation", "whole numbers in DEC order", jump, whole=True,
               processor="DEC")  # fmt: skip
    yield _c3d("Vicon Workstation", "whole numbers in MIPS order", hop, whole=True,
               processor="MIPS")  # fmt: skip
    qtm = {"MANUFACTURER": {"COMPANY": ["Qualisys AB"]}, "POINT": screen("+Y", "+Z")}
    yield _c3d("Qualisys", "z up, and said", jumper("qtm"), groups=qtm)
    yield _c3d("OptiTrack Motive", "m with y up, not said", hop, up="y", unit="m",
               truth={"has_landings": True})  # fmt: skip
    yield _c3d("OptiTrack Motive", "mm with y up, said", jumper("words"), up="y",
               groups={"POINT": screen("+X", "+Y")})  # fmt: skip
    yield _c3d("Cortex", "mm with z up, 200 Hz", hopper(3, 1200, 200.0),
               truth={"has_landings": True})  # fmt: skip
    yield _c3d("Cortex", "y up", jumper("small letters"), up="y")
    yield _c3d("BTS Smart", "m with y up", jumper("opensim"), up="y", unit="m")
    yield _c3d("Codamotion", "250 Hz, frames from 1000", hopper(4, 1500, 250.0),
               first=1000, truth={"has_landings": True})  # fmt: skip
    yield _c3d("Simi", "cm", hop, unit="cm")
    yield _c3d("a lab", "inches", hop, unit="inch")
    yield _c3d("a lab", "z points down", hop, up="-z", truth={"has_landings": True})
    yield _c3d("a lab", "y points down", jump, up="-y")
    yield _c3d("a lab", "x up", hop, up="x")
    yield _c3d("a lab", "screen says y, markers fall along z", hop,
               groups={"POINT": screen("+X", "+Y")})  # fmt: skip
    yield _c3d("a lab", "states m, numbers are mm", hop,
               groups={"POINT": {"UNITS": ["m"]}})  # fmt: skip
    yield _c3d("a lab", "static trial, y up", stander(), up="y")
    yield _c3d("a lab", "static trial, z up", stander("qtm"))
    yield _c3d("a lab", "markers of numbers only", jumper("numbers"))
    yield _c3d("a lab", "one jump in 300 Hz", jumper(seed=5, jumps=1, rate_hz=300.0),
               truth={"has_landings": True})  # fmt: skip


def _motions():
    """Return motions without a flight, or of someone who is not upright."""
    strolls = {"on a treadmill": walker(), "over ground": walker(on_treadmill=False)}
    for habit, animal in strolls.items():
        yield _c3d("walking", f"{habit}, z up", animal)
        yield _c3d("walking", f"{habit}, y up", animal, up="y")
        yield _trc("walking", f"{habit}, m, y up", animal, unit="m")
    numbers = walker("numbers", 2)
    yield _c3d("walking", "markers of numbers only", numbers)
    yield _c3d("walking", "z points down", walker("qtm", 3), up="-z")
    yield _c3d("running", "z up", running())
    yield _trc("running", "m, y up", running(2), unit="m")
    yield _c3d("not upright", "lying on the back, z up", turned_person("lying"))
    yield _c3d("not upright", "lying on the back, y up", turned_person("lying"), up="y")
    yield _c3d("not upright", "a handstand, z up", turned_person("handstand"))
    yield _c3d("not upright", "a handstand, y up, said", turned_person("handstand", "qtm"),
               up="y", groups={"POINT": screen("+X", "+Y")})  # fmt: skip
    for up in ("z", "y"):
        yield _c3d("seated", f"an arm that reaches, {up} up", reaching(), up=up,
                   truth={"has_roles": False})  # fmt: skip


def _c3d_of_writers():
    hop = hopper()
    n_frames = len(hop.positions)
    point = {"POINT": {}}
    analog = np.random.default_rng(5).normal(0, 1, (n_frames, 10, 6))
    for habit, groups in {
        "no unit": {"POINT": {"UNITS": None}},
        "an empty unit": {"POINT": {"UNITS": [""]}},
        "a rate of 0 in the parameters": {"POINT": {"RATE": np.float32(0)}},
        "no rate in the parameters": {"POINT": {"RATE": None}},
        "no group TRIAL": {"TRIAL": dict.fromkeys(("ACTUAL_START_FIELD", "ACTUAL_END_FIELD"))},
        "no POINT:FRAMES": {"POINT": {"FRAMES": None}},
        "no POINT:SCALE": {"POINT": {"SCALE": None}},
        "a positive POINT:SCALE beside floats": {"POINT": {"SCALE": np.float32(0.1)}},
        "events": {"EVENT": {"USED": 1, "LABELS": ["Foot Strike"], "CONTEXTS": ["Left"],
                             "TIMES": np.array([[0.0, 0.5]], "f4")}},
        "an event without a time": {"EVENT": {"USED": 1, "LABELS": ["Foot Strike"]}},
        "a group of force plates": {"FORCE_PLATFORM": {"USED": 1, "TYPE": np.array([2])}},
    }.items():  # fmt: skip
        yield _c3d("a writer of C3D", habit, hop, groups=groups)
    unnamed = replace(hop, names=("",) * len(hop.names))
    yield _c3d("a writer of C3D", "no labels", unnamed, truth={"has_roles": False},
               groups={"POINT": {"LABELS": None}})  # fmt: skip
    yield _c3d("a writer of C3D", "analog channels", hop, analog=analog, groups=point)
    yield _c3d("a writer of C3D", "all residuals below 0", hopper(gaps=False),
               seen_word=-1.0)  # fmt: skip
    yield _c3d("a writer of C3D", "masks of eight cameras", hop, seen_word=-32511.0)
    yield _c3d("a writer of C3D", "residuals of 0.4", hop, seen_word=0.4)
    yield _c3d(
        "a writer of C3D", "NaN where unseen", hop, unseen=np.nan, unseen_word=0.0
    )
    yield _c3d("a writer of C3D", "-9999 where unseen", hop, unseen=-9999.0,
               unseen_word=0.0)  # fmt: skip
    yield _c3d("a writer of C3D", "last frame 0 in the header", hop, header={"last": 0})
    yield _c3d("a writer of C3D", "rate only in the parameters", hop,
               header={"rate": 0.0})  # fmt: skip
    yield _c3d("a writer of C3D", "no rate anywhere", hop, header={"rate": 0.0},
               groups={"POINT": {"RATE": np.float32(0)}},
               file="no rate is stated")  # fmt: skip
    fragments = tuple(f"*{k}" for k in range(293))
    many = hop.with_more(fragments, np.full((n_frames, 293, 3), np.nan))
    yield _c3d("a writer of C3D", "300 labels, most of fragments", many)
    twice = hop.named("hip", "hip", "hip3", "toe1", "toe2", "toe3", "post")
    yield _c3d("a writer of C3D", "a name that is there twice", twice,
               truth={"has_roles": False})  # fmt: skip
    padded = hop.named(*(f"{name}   " for name in hop.names))
    yield replace(_c3d("a writer of C3D", "blanks behind names", padded), animal=hop)
    rng = np.random.default_rng(np.random.SeedSequence(19))
    walk = np.round(1.0 + np.cumsum(rng.normal(0, 1e-4, (70_000, 1, 3)), axis=0), 5)
    one = Animal(("post",), walk, 100.0, (), (), None)
    yield _c3d("a writer of C3D", "70,000 frames", one, truth={"has_roles": False})
    whole = _c3d("a writer of C3D", "cut short", hop, file="frames are missing")
    yield replace(whole, content=whole.content[:-20_000])
    only = np.zeros((n_frames, 0, 3))
    yield Case("a writer of C3D", "analog channels only", ".c3d",
               vendors.c3d(only, (), analog=analog), hop,
               file="no markers in it")  # fmt: skip
    yield Case("a writer of C3D", "neither points nor channels", ".c3d",
               vendors.c3d(only, ()), hop, file="no markers in it")  # fmt: skip


def _c3d_with_rotations():
    hop = hopper()
    places = in_file(hop)
    data = vendors.theia(places, hop.names)
    yield Case("Theia3D", "rotations instead of points", ".c3d", data, hop)
    points = (tuple(f"p{k}" for k in range(7)), np.nan_to_num(places) + 1.0)
    beside = vendors.theia(places, hop.names, points=points)
    yield Case("Theia3D", "rotations beside points", ".c3d", beside, hop,
               has_roles=False)  # fmt: skip
    metres = vendors.theia(in_file(hop, unit="m"), hop.names, unit="m", ratio=2)
    yield Case("Theia3D", "in m, two samples a frame", ".c3d", metres, hop, unit="m")


def _trc(
    program, habit, animal, *, up="y", unit="mm", change=None, truth=None, **options
):
    """Return a case of TRC; `change` is applied to the text."""
    options = {"unit": unit, "rate_hz": animal.rate_hz, **options}
    text = trc_text(in_file(animal, up, unit), animal.names, **options)
    content = change(text) if change else text
    given = {"up": up, "unit": as_read(unit), **(truth or {})}
    return Case(program, habit, ".trc", content, animal, **given)


def _trc_of_programs():
    hop, jump = hopper(), jumper()
    yield _trc("OpenSim", "m with y up", hop, unit="m", truth={"has_landings": True})
    yield _trc("OpenSim", "mm with y up", jumper("opensim"))
    yield _trc("Cortex", "mm with z up", hop, up="z", tab="\t")
    yield _trc("Cortex", "names of virtual markers without columns", hop, up="z",
               change=lambda t: t.replace("\tpost\n", "\tpost\t\t\tV_knee\t\t\tV_hip\n"))  # fmt: skip
    yield _trc("OpenCap", "60 Hz, m, y up", jumper("words", 2, 2, 60.0), unit="m",
               truth={"has_landings": True})  # fmt: skip
    yield _trc("Pose2Sim", "30 Hz, m, y up, no frame stated", hopper(2, 300, 30.0), unit="m",
               values={"OrigDataStartFrame": "0"})  # fmt: skip
    yield _trc("Motive", "names with colons, y up", jump.named(
        *(f"Skeleton1:{name}" for name in jump.names)))  # fmt: skip
    yield _trc("EVaRT", "separated by blanks", hopper(gaps=False), up="z",
               change=lambda t: t.replace("\t\t\t", "\t").replace("\t", " "))  # fmt: skip
    yield _trc("BTS", "cm", hop, unit="cm")
    yield _trc("a lab's TRC", "z points down", hop, up="-z")


def _without_last_cells(text):
    """Leave out the last three cells of rows in which the last marker is unseen."""
    return "\n".join(line.rstrip("\t") for line in text.split("\n"))


def _trc_of_people():
    hop = hopper()
    last = replace(hop, positions=hop.positions.copy())
    last.positions[100:150, 6] = np.nan
    yield _trc("a lab's TRC", "rows end where the last marker is unseen", last,
               change=_without_last_cells)  # fmt: skip
    for habit, change in {
        "a wrong NumFrames": lambda t: t.replace("\t600\t7\t", "\t999\t7\t"),
        "a wrong NumMarkers": lambda t: t.replace("\t600\t7\t", "\t600\t9\t"),
        "blank lines among the rows": lambda t: t.replace("\n300\t", "\n\n\n300\t"),
        "a blank line at the end": lambda t: t + "\n\n",
        "decimal commas": lambda t: decimal_commas(t, "\t"),
        "lines end in CR": lambda t: t.replace("\n", "\r"),
        "no line of X1 Y1 Z1": lambda t: "\n".join(
            line for line in t.split("\n") if not line.startswith("\t\tX1")),
        "saved as a spreadsheet, with commas": lambda t: t.replace("\t", ","),
        "missing is NaN": lambda t: "\n".join(
            line.replace("\t\t", "\tNaN\t").replace("\t\t", "\tNaN\t") if line[:1].isdigit() else line
            for line in t.split("\n")),
        "quotes about the file": lambda t: t.replace("trial.trc", '"C:\\hop 1\\trial.trc"'),
        "a rate of 0": lambda t: t.replace("100\t100\t600", "0\t0\t600"),
        "a rate with a comma": lambda t: t.replace("100\t100\t600", "100,00\t100,00\t600"),
        "no unit": lambda t: t.replace("\tmm\t", "\t").replace("\tUnits", ""),
        "a byte order mark": lambda t: "\ufeff" + t,
        "frames from 0": lambda t: "\n".join(
            f"{int(a) - 1}\t{b}" if a.isdigit() and b.count("\t") > 12 else line
            for line in t.split("\n") for a, _, b in [line.partition("\t")]),
    }.items():  # fmt: skip
        yield _trc("a lab's TRC", habit, hop, change=change)
    unnamed = hop.named("hip1", "", "hip3", "toe1", "toe2", "toe3", "post")
    yield _trc(
        "a lab's TRC", "a column without a name", unnamed, truth={"has_roles": False}
    )
    typed = hop.named("hip1", "hip2", "hip3", "toe1", "toe2", "toe3", "“post”")
    yield _trc("a lab's TRC", "names in Windows-1252", typed,
               change=lambda t: t.encode("cp1252"))  # fmt: skip
    hard = hop.named("hip\xa01", "hip\xa02", "hip\xa03", "toe1", "toe2", "toe3", "post")
    yield _trc("a lab's TRC", "hard blanks in names", hard, truth={"has_roles": False})
    wrong = _trc("a lab's TRC", "states 250 Hz, stamps run at 100", hop,
                 values={"DataRate": "250", "CameraRate": "250"})  # fmt: skip
    yield replace(wrong, file=READ)
    ms = hopper(5, 1440, 240.0)
    yield _trc("a lab's TRC", "time in whole ms at 240 Hz", ms, change=_to_ms)


def _to_ms(text):
    """Round the time of each row to ms."""
    lines = []
    for line in text.split("\n"):
        fields = line.split("\t")
        if fields[0].isdigit() and len(fields) > 12:
            fields[1] = f"{float(fields[1]):.3f}"
        lines.append("\t".join(fields))
    return "\n".join(lines)


def _qtm():
    hop, jump = hopper(), jumper("qtm")

    def tsv(animal, **options):
        places = in_file(animal)
        rows = [
            "\t".join([str(k + 1), f"{k / animal.rate_hz:.5f}",
                       *("" if np.isnan(x) else f"{x:.3f}" for x in np.ravel(row))])
            for k, row in enumerate(places)
        ]  # fmt: skip
        return qtm_text(
            places,
            names=animal.names,
            rows=rows,
            frequency=f"{animal.rate_hz:g}",
            **options,
        )

    whole = tsv(hop)
    yield Case("QTM", "whole header", ".tsv", whole, hop, has_landings=True)
    yield Case("QTM", "marker set of Qualisys", ".tsv", tsv(jump), jump)
    yield Case("QTM", "no row of columns", ".tsv", tsv(hop, column_row=False), hop)
    yield Case("QTM", "saved with Latin-1 names", ".tsv",
               tsv(hop.named("hüft1", "hüft2", "hüft3", "toe1", "toe2", "toe3", "post"))
               .encode("latin-1"),
               hop.named("hüft1", "hüft2", "hüft3", "toe1", "toe2", "toe3", "post"))  # fmt: skip
    yield Case("QTM", "decimal commas", ".tsv", decimal_commas(whole, "\t"), hop)
    yield Case("QTM", "events", ".tsv",
               tsv(hop, header={"EVENT": "strike\t6\t0.05000"}), hop)  # fmt: skip
    yield Case("QTM", "6D bodies", ".tsv", tsv(hop, header={"DATA_INCLUDED": "6D"}), hop,
               file="poses of bodies, not points")  # fmt: skip
    yield Case("QTM", "cut within a row", ".tsv", whole[:-40], hop,
               file="the last row is cut")  # fmt: skip
    yield Case("QTM", "UTF-16", ".tsv", whole.encode("utf-16"), hop)


def _motive():
    hop = hopper()
    for habit, unit, metres in (
        ("version 1.23, mm", "Millimeters", "mm"),
        ("m", "Meters", "m"),
        ("cm", "Centimeters", "mm"),
    ):
        text = motive(in_file(hop, "y"), hop.names, unit=unit)
        yield Case("Motive CSV", habit, ".csv", text, hop, up="y", unit=metres)
    text = motive(in_file(hop, "y"), hop.names)
    yield Case("Motive CSV", "version 1.1, without types of spaces", ".csv",
               text.replace("Version,1.23", "Version,1.1").replace(",Coordinate Space,Global", ""), hop,
               up="y")  # fmt: skip
    yield Case("Motive CSV", "decimal commas and semicolons", ".csv",
               decimal_commas(text, ","), hop, up="y")  # fmt: skip
    quality = text.replace("Mean Marker Error", "Marker Quality")
    yield Case("Motive CSV", "a row of qualities", ".csv", quality, hop, up="y")
    old = ["comment,OptiTrack Tracking Tools", "info,version,1.1", "info,framecount,2"]
    old += [
        "rigidbody,1,pelvis,3",
        "frame,0,0.0,1,1,0.1,0.2,0.3",
        "frame,1,0.01,1,1,0,0,0",
    ]
    yield Case("Motive CSV", "Tracking Tools, before Motive", ".csv", "\n".join(old) + "\n",
               hop, file="one record a frame, of changing length")  # fmt: skip


def _nexus():
    hop = hopper()
    text = nexus(in_file(hop), hop.names)
    lone = nexus(in_file(hop), hop.names, others=False)
    for habit, content in {
        "devices above, model outputs below": text,
        "model outputs first": nexus(in_file(hop), hop.names, others="first"),
        "trajectories alone": lone,
        "no subject": text.replace("cat:", ""),
        "names end early": text.replace(",,\nFrame", "\nFrame"),
        "saved by a spreadsheet": lone.replace("\nFrame", "," * 9 + "\nFrame"),
        "decimal commas and semicolons": decimal_commas(lone, ","),
        "velocities beside": lone.replace("Trajectories", "TRAJECTORIES"),
    }.items():
        yield Case("Nexus CSV", habit, ".csv", content, hop)
    devices = "Devices\n1000\n,,Force,,\nFrame,Sub Frame,Fx,Fy,Fz\n,,N,N,N\n1,0,1,2,3\n"
    yield Case("Nexus CSV", "devices only", ".csv", devices, hop,
               file="no markers in it")  # fmt: skip


def tidy(animal, *, unit="mm", up="z", axes=("_x", "_y", "_z"), mark=",", lead="time",
         stamp="{:.4f}"):  # fmt: skip
    """Return a table with a row for each frame."""
    places = in_file(animal, up, unit)
    heads = [lead, *(f"{name}{axis}" for name in animal.names for axis in axes)]
    rows = [
        mark.join([stamp.format(k / animal.rate_hz), cells(row).replace(",", mark)])
        for k, row in enumerate(places)
    ]
    return "\n".join([mark.join(heads), *rows]) + "\n"


def _tables():
    hop = hopper()
    text = tidy(hop)
    yield Case("a table", "_x _y _z, mm", ".csv", text, hop, has_landings=True)
    yield Case("a table", "in m", ".csv", tidy(hop, unit="m"), hop, unit="m")
    yield Case("a table", "in cm", ".csv", tidy(hop, unit="cm"), hop, unit="cm")
    yield Case("a table", "unit behind the names", ".csv",
               tidy(hop, unit="m", axes=("_x (m)", "_y (m)", "_z (m)")), hop, unit="m")  # fmt: skip
    yield Case(
        "a table", "names with dots", ".csv", tidy(hop, axes=(".X", ".Y", ".Z")), hop
    )
    yield Case("a table", "names in brackets", ".csv",
               tidy(hop, axes=(" [x]", " [y]", " [z]")), hop)  # fmt: skip
    yield Case("a table", "tabs in .txt", ".txt", tidy(hop, mark="\t", axes=("X", "Y", "Z"),
               lead="Time"), hop)  # fmt: skip
    yield Case("a table", "Excel's line sep=;", ".csv",
               "sep=;\n" + tidy(hop, mark=";"), hop)  # fmt: skip
    yield Case("a table", "decimal commas and semicolons", ".csv",
               decimal_commas(text, ","), hop)  # fmt: skip
    yield Case("a table", "comments above", ".csv", "# hop\n# Anna\n" + text, hop)
    yield Case("a table", "quoted names", ".csv",
               ",".join(f'"{name}"' for name in text.split("\n", 1)[0].split(","))
               + "\n" + text.split("\n", 1)[1], hop)  # fmt: skip
    yield Case("a table", "time in ms", ".csv",
               tidy(hop, stamp="{:.4f}").replace("time,", "time,", 1), hop)  # fmt: skip
    thousand = replace(hop, rate_hz=hop.rate_hz / 1000)
    yield Case("a table", "stamps in ms", ".csv", tidy(thousand, stamp="{:.0f}"), hop,
               file="time in ms is not said")  # fmt: skip
    yield Case("a table", "x y forwards, y up", ".csv", tidy(hop, up="y"), hop, up="y")
    frames = tidy(replace(hop, rate_hz=1.0), lead="frame", stamp="{:.0f}")
    yield Case(
        "a table", "frames and no time, rate given", ".csv", frames, hop, given_hz=100.0
    )
    yield Case(
        "a table", "frames and no time", ".csv", frames, hop, file="no rate is stated"
    )
    long = ["frame,marker,x,y,z"]
    long += [f"{k},{name},{cells(row[m])}" for k, row in enumerate(in_file(hop)[:50])
             for m, name in enumerate(hop.names)]  # fmt: skip
    yield Case("a table", "a row for each marker", ".csv", "\n".join(long) + "\n", hop,
               file="it must be turned first")  # fmt: skip
    heads = "," + ",".join(name for name in hop.names for _ in range(3))
    axes = "frame," + ",".join("xyz" * len(hop.names))
    rows = [f"{k},{cells(row)}" for k, row in enumerate(in_file(hop))]
    yield Case("a table", "two rows of names, as pandas", ".csv",
               "\n".join([heads, axes, *rows]) + "\n", hop, given_hz=100.0)  # fmt: skip
    tab = tidy(hop, mark="\t", axes=("X", "Y", "Z"), lead="ITEM")
    yield Case("Visual3D", "names, types and axes above", ".txt", _visual3d(hop), hop,
               given_hz=100.0)  # fmt: skip
    yield Case("a table", "an unknown first column", ".txt", tab, hop,
               file="what ITEM counts is not said")  # fmt: skip


def _visual3d(animal):
    """Return Visual3D's ASCII export: file, signal, type, folder and axis of each column."""
    names = [name for name in animal.names for _ in range(3)]
    n = len(names)
    rows = [
        "\t".join(["", *["trial.c3d"] * n]),
        "\t".join(["", *names]),
        "\t".join(["", *["TARGET"] * n]),
        "\t".join(["", *["ORIGINAL"] * n]),
        "\t".join(["ITEM", *["X", "Y", "Z"] * len(animal.names)]),
    ]
    for k, row in enumerate(in_file(animal)):
        rows.append("\t".join([str(k + 1), *cells(row).split(",")]))
    return "\n".join(rows) + "\n"


def _keypoints():
    hop = hopper()
    places = in_file(hop)
    scores = np.full(places.shape[:2], 0.9)
    given = {"given_hz": 100.0}
    yield Case(
        "Anipose", "CSV", ".csv", anipose(places, hop.names, scores), hop, **given
    )
    yield Case("Anipose", "CSV without a rate", ".csv", anipose(places, hop.names, scores),
               hop, file="no rate is stated")  # fmt: skip
    yield Case(
        "DeepLabCut", "CSV", ".csv", deeplabcut(places, hop.names, scores), hop, **given
    )
    yield Case("DeepLabCut", "CSV, y points down as in an image", ".csv",
               deeplabcut(in_file(hop, "-y"), hop.names, scores), hop, up="-y", **given)  # fmt: skip
    plane = deeplabcut(places, hop.names).replace(",z", ",w")
    yield Case("DeepLabCut", "one camera", ".csv", plane, hop, file="a plane has no landing",
               **given)  # fmt: skip
    heads = columns(hop.names)
    for kind, write in (("rows", pandas_rows), ("blocks", pandas_blocks)):
        values = table(places, scores)
        yield Case("DeepLabCut", f"HDF5, {kind}", ".h5",
                   _by(write, heads, values), hop, **given)  # fmt: skip
    media = hop.named("left_hip", "right_hip", "nose", "left_heel", "right_heel",
                      "left_foot_index", "chair")  # fmt: skip
    free = tidy(media, unit="mm").replace("time,", "", 1)
    free = "\n".join(line if not k else line.split(",", 1)[1]
                     for k, line in enumerate(free.strip().split("\n"))) + "\n"  # fmt: skip
    yield Case("FreeMoCap", "a table of keypoints without a clock", ".csv", free, media,
               has_roles=False, **given)  # fmt: skip


def _by(write, *content, **options):
    return lambda path: write(path, *content, **options)


def _sleap():
    hop = hopper()
    places = in_file(hop)
    scores = np.full(places.shape[:2], 0.9)
    given = {"given_hz": 100.0}

    def analysis(**options):
        return _by(vendors.sleap_analysis, places, hop.names, **options)

    yield Case("SLEAP", "analysis HDF5", ".h5", analysis(), hop, **given)
    yield Case("SLEAP", "analysis HDF5 with dims and scores", ".h5",
               analysis(dims=True, scores=scores), hop, **given)  # fmt: skip
    yield Case("SLEAP", "analysis CSV", ".csv", vendors.sleap_csv(places, hop.names), hop,
               **given)  # fmt: skip
    yield Case("SLEAP", "analysis CSV of one camera", ".csv",
               vendors.sleap_csv(places, hop.names, axes="xy"), hop,
               file="a plane has no landing", **given)  # fmt: skip
    yield Case("SLEAP", "analysis HDF5 of one camera", ".h5",
               _by(vendors.sleap_analysis, places[:, :, :2], hop.names), hop,
               file="a plane has no landing", **given)  # fmt: skip


def _mat_and_bids():
    hop, jump = hopper(), jumper("qtm")
    struct = qtm_struct(np.nan_to_num(in_file(hop)), hop.names)
    yield Case("QTM MAT", "version 5", ".mat", _by(write_mat5, struct), hop)
    yield Case("QTM MAT", "version 7.3", ".mat", _by(write_mat73, struct), hop)
    late = qtm_struct(np.nan_to_num(in_file(jump)), jump.names, start=101)
    yield Case("QTM MAT", "from frame 101", ".mat", _by(write_mat5, late), jump)
    own = Recording("trial", np.arange(len(hop.positions)) / 100, hop.positions, hop.names,
                    ("body",) * 3 + ("foot",) * 3 + ("boom",), 100.0)  # fmt: skip
    yield Case(
        "hopdata", "our own HDF5", ".h5", _by(write_recording, own), hop, unit="m"
    )

    def bids(unit, **options):
        places = in_file(hop, unit=unit)
        return lambda path: write_bids(path.parent / "motion", places, hop.names,
                                       unit=unit, **options)  # fmt: skip

    yield Case("Motion-BIDS", "mm, axes not said", "", bids("mm"), hop)
    yield Case("Motion-BIDS", "m, z up", "", bids("m", spatial="ALS"), hop, unit="m")


def _skeletons():
    hop, jump = hopper(gaps=False), jumper("words")
    for habit, unit in (("cm", "cm"), ("m", "m"), ("mm", "mm")):
        data = vendors.bvh(in_file(hop, "y", unit), hop.names)
        # The reader turns cm to mm.
        yield Case("BVH", f"{habit}, y up", ".bvh", data, hop, up="y",
                   unit="m" if unit == "m" else "mm")  # fmt: skip
    yield Case("BVH", "a person, tabs, rounded frame time", ".bvh",
               vendors.bvh(in_file(jump, "y", "cm"), jump.names, tab=True, digits=3), jump,
               up="y")  # fmt: skip
    yield Case(
        "BVH", "z up", ".bvh", vendors.bvh(in_file(hop, "z", "cm"), hop.names), hop
    )
    yield Case("BVH", "a skeleton without frames", ".bvh",
               vendors.bvh(in_file(hop, "y", "cm")[:0], hop.names), hop,
               file="no motion in it")  # fmt: skip
    yield Case("Xsens", "MVNX", ".mvnx", vendors.mvnx(in_file(hop, unit="m"), hop.names), hop,
               unit="m", has_landings=True)  # fmt: skip
    yield Case("Xsens", "MVNX from frame 500, no namespace", ".mvnx",
               vendors.mvnx(in_file(jump, unit="m"), jump.names, first=500, namespace=False),
               jump, unit="m")  # fmt: skip
    sound = vendors.mvnx(in_file(hop, unit="m"), hop.names).decode()
    entity = sound.replace("<mvnx ", '<!DOCTYPE m [<!ENTITY a "b">]><mvnx ')
    yield Case("Xsens", "MVNX with an entity", ".mvnx", entity, hop,
               file="entities can expand without limit")  # fmt: skip
    only = sound.replace("<position>", "<velocity>").replace(
        "</position>", "</velocity>"
    )
    yield Case("Xsens", "MVNX without positions", ".mvnx", only, hop,
               file="no positions in it")  # fmt: skip


def _further_programs():
    hop, jump = hopper(), jumper()
    yield Case("Cortex TRB", "mm, z up", ".trb", vendors.trb(in_file(hop), hop.names), hop,
               has_landings=True)  # fmt: skip
    yield Case("Cortex TRB", "frame numbers that begin anew at 65,536", ".trb",
               vendors.trb(in_file(jump), jump.names, first_frame=65_400), jump)  # fmt: skip
    sound = vendors.trb(in_file(hop), hop.names)
    whole = replace(hop, positions=hop.positions[:-1])  # without the frame that is cut
    yield Case("Cortex TRB", "cut within a frame", ".trb", sound[:-30], whole)
    series = vendors.ktk_series(in_file(hop, unit="m"), hop.names)
    several = {"Trial": {"Markers": series, "Note": "hop", "Angles": {"class__": "x"}}}
    yield Case("Kinetics Toolkit", "a series in dictionaries", ".ktk.zip",
               vendors.ktk(several), hop, unit="m")  # fmt: skip
    yield Case("Kinetics Toolkit", "y up, unit not said", ".ktk.zip",
               vendors.ktk(vendors.ktk_series(in_file(hop, "y", "m"), hop.names, unit="")),
               hop, up="y", unit="m")  # fmt: skip
    yield Case("Kinetics Toolkit", "no points", ".ktk.zip", vendors.ktk({"a": 1}), hop,
               file="no markers in it")  # fmt: skip
    yield Case("Kinetics Toolkit", "another zip file", ".ktk.zip",
               vendors.zipped({"a.txt": "b"}), hop, file="not what it saves")  # fmt: skip
    yield Case("D-Flow", "force plates beside, y up", ".txt",
               vendors.dflow(in_file(hop, "y", "m"), hop.names), hop, up="y", unit="m",
               has_landings=True)  # fmt: skip
    yield Case("D-Flow", "frames from 9871, zeros where unseen", ".txt",
               vendors.dflow(in_file(hop, "y", "m"), hop.names, held=False, first=9871), hop,
               up="y", unit="m")  # fmt: skip
    blanks = vendors.dflow(in_file(hop, "y", "m"), hop.names).replace(
        b"post.", b" post."
    )
    yield Case(
        "D-Flow", "blanks before short names", ".txt", blanks, hop, up="y", unit="m"
    )


def _workbooks():
    hop = hopper()
    rows = vendors.table_of(in_file(hop), hop.names)
    yield Case("Excel", "a tidy sheet behind notes", ".xlsx",
               vendors.xlsx({"notes": [["hop"]], "data": rows}), hop)  # fmt: skip
    yield Case("Excel", "names above three columns each", ".xlsx",
               vendors.xlsx({"data": _merged(hop)}), hop, given_hz=100.0)  # fmt: skip
    places = in_file(hop, unit="m")
    axes = (" x", " y", " z")
    frames = [["Frame", *row[1:]] if not k else [k - 1, *row[1:]]
              for k, row in enumerate(vendors.table_of(places, hop.names, axes=axes))]  # fmt: skip
    turned = [frames[0], *([row[0], *(3.0 * x for x in row[1:])] for row in frames[1:])]
    yield Case("Xsens", "XLSX with a sheet of positions behind one of angles", ".xlsx",
               vendors.xlsx({"Segment Orientation - Euler": turned,
                             "Segment Position": frames}), hop, unit="m",
               given_hz=100.0)  # fmt: skip
    yield Case("Excel", "notes only", ".xlsx", vendors.xlsx({"notes": [["hop", "a"]]}), hop,
               file="no numbers in it")  # fmt: skip
    yield Case("Excel", "a list of results", ".xlsx",
               vendors.xlsx({"a": [["trial", "height", "n"], *[["x", 0.3, 4.0, 1.0, 2.0]] * 4]}),
               hop, file="no markers in it")  # fmt: skip


def _merged(animal):
    names = [name for one in animal.names for name in (one, "", "")]
    rows = [["", *names], ["Frame", *["x", "y", "z"] * len(animal.names)]]
    for k, row in enumerate(in_file(animal)):
        rows.append([k + 1, *(float(x) for x in np.ravel(row))])
    return rows


def _no_recordings():
    hop = hopper()
    for suffix in (".c3d", ".trc", ".csv", ".tsv", ".bvh", ".trb", ".mvnx", ".xlsx"):
        yield Case("no recording", f"an empty {suffix}", suffix, b"", hop,
                   file="it is empty")  # fmt: skip
    yield Case("no recording", "a web page as .csv", ".csv",
               "<!DOCTYPE html><html><body>404</body></html>\n", hop,
               file="a page of the web")  # fmt: skip
    yield Case("no recording", "a pointer of Git LFS as .c3d", ".c3d",
               "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", hop,
               file="a pointer to the file")  # fmt: skip
    yield Case("no recording", "a photo as .trc", ".trc", b"\x89PNG\r\n\x1a\n" + b"\0" * 99,
               hop, file="a picture")  # fmt: skip


# What the library makes of them.


def outcomes(case, folder):
    """Return the columns of what the library makes of a case."""
    path = case.write(folder)
    try:
        raw = read_raw(path, rate_hz=case.given_hz)
    except RecordingError as error:
        return {"found_file": f"refused: {fault_of(error, path)}"}
    found = {"found_file": READ}
    if case.has_roles:
        found["found_positions"] = _compared(case, raw)
    inspection = inspect_recording(raw)
    found["found_up"] = _judged(inspection.up, case.up)
    found["found_unit"] = _judged(inspection.unit, case.unit)
    found["found_rate"] = _judged(inspection.rate, f"{case.animal.rate_hz:g}")
    if case.has_roles:
        found |= _roles(case, inspection)
    if case.has_landings:
        found["found_landings"] = _landings(case, path)
    return found


def fault_of(error, path):
    """Return the code of an error, or its words without file, place and numbers."""
    if isinstance(error, RateUnknownError):
        return "rate unknown"
    if error.code:
        return error.code
    words = str(error).replace(str(path), "").lstrip(":, ")
    _, _, words = words.partition("expected ")
    shown = "".join("#" if letter.isdigit() else letter for letter in words)
    while "##" in shown:
        shown = shown.replace("##", "#")
    return f"expected {shown}"[:90].strip()


def _compared(case, raw):
    """Compare positions with the truth, of all markers by their bare names."""
    bare = [name.rpartition(":")[2] for name in case.animal.names]
    of_file = [name.rpartition(":")[2] for name in raw.markers]
    kept = [k for k, name in enumerate(bare) if name in of_file]
    if len(raw.time) != len(case.animal.positions):
        return f"{len(raw.time)} of {len(case.animal.positions)} frames"
    if not kept:
        return "no marker of that name"
    places = raw.positions[:, [of_file.index(bare[k]) for k in kept]]
    found = rotate_up(places * UNITS_IN_M[case.unit], case.up)
    truth = case.animal.positions[:, kept]
    is_right = np.abs(found - truth) < 1e-4
    is_right |= np.isnan(found) & np.isnan(truth)
    n_wrong = int((~is_right.all(axis=2)).sum())
    return "right" if not n_wrong else f"{n_wrong} of {is_right[..., 0].size} wrong"


def _judged(guess, truth):
    right = "right" if guess.value == truth else "wrong"
    return f"{right}_{'sure' if guess.is_sure else 'asked'}"


def _roles(case, inspection):
    """Return how body and feet were guessed: any of the true ones, and no other."""
    from hopdata.landings.role_guesses import guessed_roles

    roles = guessed_roles(inspection)
    found = {}
    for key, truth, least in (
        ("body", (*case.animal.body, *case.animal.trunk), 3),
        ("feet", case.animal.feet, 2),
    ):
        chosen = set(getattr(roles, key))
        if not chosen:
            found[f"found_{key}"] = "asked"
            continue
        named = {name.rpartition(":")[2] for name in truth}
        bare = {name.rpartition(":")[2] for name in chosen}
        right = "right" if bare <= named and len(bare) >= least else "wrong"
        found[f"found_{key}"] = f"{right}_{'asked' if key in roles.unsure else 'sure'}"
    return found


def _landings(case, path):
    """Return how many descents end on the true feet, in the true unit and axis."""
    animal = case.animal
    feet = animal.feet
    if len(feet) > 3:  # one marker of each foot of a person
        feet = (feet[1], feet[6])
    markers = {"body": list(animal.body), "feet": list(feet)}
    try:
        recording, _ = import_recording(
            path, name="trial", markers=markers, vertical_axis=case.up
        )
        (contacts,) = hd.study(recording).contacts.values()
    except HopdataError as error:
        return f"refused: {fault_of(error, path)}"
    instants = contacts[[f"contact_{name}_s" for name in feet]].to_numpy(float)
    return str(int(np.isfinite(instants).all(axis=1).sum()))


COLUMNS = ("file", "up", "unit", "rate_hz", "body", "feet", "landings")
FOUND = ("file", "positions", "up", "unit", "rate", "body", "feet", "landings")


def row_of(case, folder):
    """Return the row of a case: the truth and what the library makes of it."""
    truth = {
        "file": case.file,
        "up": case.up,
        "unit": case.unit,
        "rate_hz": f"{case.animal.rate_hz:g}",
        "body": " ".join(case.animal.body) if case.has_roles else "",
        "feet": " ".join(case.animal.feet) if case.has_roles else "",
        "landings": str(case.animal.landings) if case.has_landings else "",
    }
    if case.file != READ:
        truth = {"file": case.file}
    found = outcomes(case, folder)
    row = {"program": case.program, "habit": case.habit}
    row |= {key: truth.get(key, "") for key in COLUMNS}
    return row | {f"found_{key}": found.get(f"found_{key}", "") for key in FOUND}


def today():
    """Return the table of all cases as the library is now."""
    rows = []
    with TemporaryDirectory() as folder:
        for number, case in enumerate(cases()):
            place = Path(folder) / str(number)
            place.mkdir()
            rows.append(row_of(case, place))
    return pd.DataFrame(rows)


def stored():
    """Return the table that is kept beside this file."""
    return pd.read_csv(TABLE, dtype=str, keep_default_na=False)


def main():
    """Write the table again, or print it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument(
        "--write", action="store_true", help=f"write {TABLE.name} again"
    )
    options = parser.parse_args()
    found = today()
    if options.write:
        found.to_csv(TABLE, index=False)
    else:
        print(found.to_string())


if __name__ == "__main__":
    main()
