"""Sound recordings in every format, with the habits of the programs and people that wrote them.

Every variant holds the same markers at the same positions, so tests check the numbers
that a reader returns, not only that it accepts the file.
"""

import re
from dataclasses import dataclass
from unittest.mock import patch

import numpy as np
import written_files
from bids_files import write_bids
from csv_files import cells, motive, nexus
from keypoint_files import (
    anipose,
    columns,
    deeplabcut,
    pandas_blocks,
    pandas_rows,
    table,
)
from mat_files import qtm_struct, write_mat5, write_mat73
from qtm_files import NAMES, data_rows, qtm_text, standing
from trc_files import trc_text
from written_files import write_c3d

from hopdata.recording import Recording
from hopdata.recordings.raw import RawRecording
from hopdata.recordings.readers.hdf5 import write_recording

N_FRAMES, RATE = 24, 100.0
POSITIONS = np.round(standing(N_FRAMES), 3)
POSITIONS[3:5, 1] = np.nan
SCORES = np.full((N_FRAMES, len(NAMES)), 0.9)
TIME = np.arange(N_FRAMES) / RATE
NAMESETS = {
    "as usual": NAMES,
    "with dots": ("L.ASIS", "R.ASIS", "back", "L.Heel", "R.Heel"),
    "of two subjects": ("cat:hip", "dog:hip", "cat:back", "cat:toe", "dog:toe"),
    "not ASCII": ("Hüfte", "Ça", "背", "Zehe ß", "toe"),
    "numbers": ("1", "2", "3", "10", "11"),
    "in brackets": ("hip (left)", "hip [right]", "back#1", "heel/L", "toe 'R'"),
    "repeated": ("toe", "hip", "toe", "heel", "back"),
    "one empty": ("hip", "", "back", "heel", "toe"),
}


@dataclass(frozen=True)
class Variant:
    """A file: its format, its peculiarity, its name and bytes, or how it is written."""

    format: str
    habit: str
    suffix: str
    data: bytes | None = None
    write: object = None
    names: tuple = NAMES
    given_hz: float | None = None

    def file(self, folder):
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"monday{self.suffix}"
        if self.data is None:
            return self.write(path) or path
        path.write_bytes(self.data)
        return path


def bare(positions, names, *, lead="Time", axis=""):
    heads = [f"{name}{axis}{a}" for name in names for a in "XYZ"]
    body = [
        f"{t:.3f}\t" + cells(p).replace(",", "\t")
        for t, p in zip(TIME, positions, strict=True)
    ]
    return "\n".join(["\t".join([lead, *heads]), *body]) + "\n"


def tsv(positions, names, **options):
    body = [row.replace("nan", "") for row in data_rows(positions)]
    return qtm_text(positions, names=names, rows=body, **options)


def plain(positions, names, *, axis="_"):
    return bare(positions, names, lead="time", axis=axis).replace("\t", ",")


def workstation(positions, names):
    """Return Vicon's export before Nexus 2: another word for the frame, and no units."""
    body = [f"{k + 1}," + cells(p) for k, p in enumerate(positions)]
    heads = [
        "TRAJECTORIES",
        "100,Hz",
        "," + ",,,".join(names),
        "Field #" + ",X,Y,Z" * len(names),
    ]
    return "\n".join([*heads, *body]) + "\n"


def _jarvis(positions, names):
    heads = [
        ",".join(name for name in names for _ in range(4)),
        ",".join("xyz") + ",confidence",
    ]
    heads[1] = ",".join([heads[1]] * len(names))
    return "\n".join([*heads, *(cells(row) for row in table(positions, SCORES))]) + "\n"


def _dlc(positions, names):
    return deeplabcut(positions, names, SCORES)


def _anipose(positions, names):
    return anipose(positions, names, SCORES)


TEXTS = {  # format: suffix, delimiter, writer, whether a rate must be given
    "QTM": (".tsv", "\t", tsv, None),
    "table": (".txt", "\t", bare, None),
    "TRC": (".trc", "\t", trc_text, None),
    "Motive": (".csv", ",", motive, None),
    "Nexus": (".csv", ",", nexus, None),
    "Workstation": (".csv", ",", workstation, None),
    "plain CSV": (".csv", ",", plain, None),
    "Anipose": (".csv", ",", _anipose, RATE),
    "JARVIS": (".csv", ",", _jarvis, RATE),
    "DeepLabCut": (".csv", ",", _dlc, RATE),
}


def _is_row(line, mark):
    parts = [part.strip() for part in line.split(mark)]
    filled = [p for p in parts if p not in ("", "NULL", "Nan", "n/a")]
    numeric = all(re.fullmatch(r"[-+\d.eE:,]+", p) for p in filled)
    return len(parts) > 6 and len(filled) > 4 and numeric


def by_row(change):
    """Return a function that applies a change to each row of numbers."""

    def to_text(text, mark):
        lines = text.splitlines()
        return (
            "\n".join(change(x, mark) if _is_row(x, mark) else x for x in lines) + "\n"
        )

    return to_text


def _padded(line, mark):
    return mark.join(f" {part} " if part else "" for part in line.split(mark))


def _exponents(line, mark):
    parts = line.split(mark)
    return mark.join(
        f"{float(p):.9e}" if k > 2 and "." in p else p for k, p in enumerate(parts)
    )


def _word(word):
    def change(line, mark):
        parts = line.split(mark)
        return mark.join(
            word if k > 1 and not part else part for k, part in enumerate(parts)
        )

    return by_row(change)


def _quoted(line, mark):
    return mark.join(f'"{part}"' for part in line.split(mark))


def decimal_commas(text, mark):
    changed = re.sub(
        r"(?<=\d)\.(?=\d)", ",", text if mark != "," else text.replace(",", ";")
    )
    return changed.replace("Version;1,23", "Version;1.23")


HABITS = {  # changes to the text of any format, with cells separated by `m`
    "as it is": lambda t, _: t,
    "lines end in LF": lambda t, _: t.replace("\r\n", "\n"),
    "lines end in CRLF": lambda t, _: t.replace("\r\n", "\n").replace("\n", "\r\n"),
    "a byte order mark": lambda t, _: "\ufeff" + t,
    "empty lines at the end": lambda t, _: t + "\n\n\n",
    "a line of marks at the end": lambda t, m: t + m * 3 + "\n",
    "no end of the last line": lambda t, _: t.rstrip("\r\n"),
    "a mark at each row's end": by_row(lambda line, m: line + m),
    "blanks about numbers": by_row(_padded),
    "blanks at each line's end": lambda t, _: t.replace("\r\n", "\n").replace(
        "\n", " \n"
    ),
    "exponents": by_row(_exponents),
    "missing is Nan": _word("Nan"),
    "missing is NULL": _word("NULL"),
    "missing is n/a": _word("n/a"),
    "missing is zero": _word("0.000"),
    "decimal commas": decimal_commas,
}
OF_CSV = {
    "tabs for commas": lambda t, _: t.replace(",", "\t"),
    "semicolons": lambda t, _: t.replace(",", ";"),
    "quoted cells": by_row(_quoted),
    "marks filled up": lambda t, _: _filled_up(t),
}


def _filled_up(text):
    """Pad short header lines with commas, as a spreadsheet does when it saves."""
    lines = text.splitlines()
    width = max(line.count(",") for line in lines)
    return "\n".join(line + "," * (width - line.count(",")) for line in lines) + "\n"


def _start(line, mark):
    """Begin a frame's number at 101."""
    first, rest = line.split(mark, 1)
    return f"{int(first) + 100}{mark}{rest}" if first.isdigit() else line


def variants():
    """Return all variants, with the formats in turn."""
    return [*_of_texts(), *_of_single_formats(), *_of_binaries()]


def _of_texts():
    for kind, (suffix, mark, write, hz) in TEXTS.items():
        text = write(POSITIONS, NAMES)
        habits = HABITS | (OF_CSV if mark == "," else {})
        if kind in ("QTM", "TRC", "Nexus", "Workstation", "Motive"):
            habits = habits | {"frames from 101": by_row(_start)}
        for habit, change in habits.items():
            yield Variant(kind, habit, suffix, change(text, mark).encode(), given_hz=hz)
        for habit, names in NAMESETS.items():
            for code in ("utf-8", "latin-1"):
                if habit == "not ASCII" and code == "latin-1":
                    names = tuple(name.replace("背", "Rück") for name in names)
                elif code == "latin-1" or (habit == "repeated" and hz):
                    continue  # keypoints are columns of one table, whose names differ
                data = write(POSITIONS, names).encode(code)
                yield Variant(
                    kind, f"names {habit}, {code}", suffix, data, None, names, hz
                )
        for habit, data in {
            "UTF-16": text.encode("utf-16"),
            "UTF-16, the other order": b"\xfe\xff" + text.encode("utf-16-be"),
            "lines end in CR": text.replace("\r\n", "\n").replace("\n", "\r").encode(),
        }.items():
            yield Variant(kind, habit, suffix, data, given_hz=hz)
        if mark == "," or kind in ("QTM", "table"):
            other = text.replace("\r\n", "\n")
            for habit, to in {"tabs": "\t", "semicolons": ";", "commas": ","}.items():
                for end in (".csv", ".txt"):
                    changed = (
                        other.replace("2021-01-01, 12", '"2021-01-01, 12')
                        if to == ","
                        else other
                    )
                    yield Variant(
                        kind,
                        f"{habit} in {end}",
                        end,
                        changed.replace(mark, to).encode(),
                        given_hz=hz,
                    )


def _of_single_formats():
    def text(kind, habit, content, **more):
        return Variant(kind, habit, TEXTS[kind][0], content.encode(), **more)

    whole = tsv(POSITIONS, NAMES)
    for habit, header in {
        "too many frames stated": {"NO_OF_FRAMES": "99"},
        "too few frames stated": {"NO_OF_FRAMES": "9"},
        "another number of markers": {"NO_OF_MARKERS": "6"},
        "no types of trajectories": {"TRAJECTORY_TYPES": None},
        "too few types": {"TRAJECTORY_TYPES": "Measured\tVirtual"},
        "a version": {"FILE_VERSION": "2.0.0"},
        "no time stamp": {"TIME_STAMP": None},
        "an event": {"EVENT": "strike\t6\t0.05000"},
        "no frequency": {"FREQUENCY": None},
        "an unknown key": {"SUBJECT": "cat"},
        "two dates": {
            "TIME_STAMP": "2021-01-01, 12:00:00\r\nTIME_STAMP\t2022-01-01, 12:00:00"
        },
    }.items():
        yield text("QTM", habit, tsv(POSITIONS, NAMES, header=header))
    yield text("QTM", "no row of columns", tsv(POSITIONS, NAMES, column_row=False))
    yield text("QTM", "small letters", whole.replace("Frame\tTime", "frame\ttime"))
    yield text(
        "QTM", "no MARKER_NAMES", tsv(POSITIONS, NAMES, header={"MARKER_NAMES": None})
    )
    for axis in (" ", "_", ".", ""):
        yield text(
            "table", f"'{axis}' before the axis", bare(POSITIONS, NAMES, axis=axis)
        )
        if axis:
            yield text(
                "plain CSV",
                f"'{axis}' before the axis",
                plain(POSITIONS, NAMES, axis=axis),
            )
    for unit, factor in {"mm": 1.0, "m": 1e-3, "cm": 0.1}.items():
        names, *rest = bare(POSITIONS * factor, NAMES).splitlines()
        units = "\t".join(["s", *[unit] * 3 * len(NAMES)])
        yield text(
            "table", f"a row of units, {unit}", "\n".join([names, units, *rest, ""])
        )
    trc = trc_text(POSITIONS, NAMES)
    rows = trc.split("\n")
    axes = rows[4]
    for habit, content in {
        "a space after the type": trc.replace("PathFileType\t", "PathFileType \t"),
        "spaces for tabs in the first line": trc.replace(
            rows[0], rows[0].replace("\t", " ")
        ),
        "keys in small letters": trc.replace(rows[1], rows[1].lower()),
        "Times": trc.replace("Frame#\tTime", "Frame\tTimes"),
        "too many frames stated": trc_text(
            POSITIONS, NAMES, values={"NumFrames": "99"}
        ),
        "another number of markers": trc_text(
            POSITIONS, NAMES, values={"NumMarkers": "6"}
        ),
        "an unknown key": trc_text(POSITIONS, NAMES, values={"Subject": "cat"}),
        "no rate": trc_text(POSITIONS, NAMES, values={"DataRate": None}),
        "no unit": trc_text(POSITIONS, NAMES, values={"Units": None}),
        "no original rate": trc_text(POSITIONS, NAMES, values={"OrigDataRate": None}),
        "axes not counted": trc.replace(axes, re.sub(r"\d", "", axes)),
        "axes in small letters": trc.replace(axes, axes.lower()),
        "axes from 0": trc.replace(
            axes, re.sub(r"\d", lambda d: str(int(d[0]) - 1), axes)
        ),
        "blanks between values": trc.replace(rows[2], rows[2].replace("\t", "   ")),
        "axes from 5": trc.replace(
            axes, re.sub(r"\d", lambda d: str(int(d[0]) + 4), axes)
        ),
        "seven keys": trc_text(POSITIONS, NAMES, values={"OrigNumFrames": None}),
        "no empty line": trc_text(POSITIONS, NAMES, blank=False),
        "names in each column": trc.replace(
            rows[3], "Frame#\tTime\t" + "\t".join(n for n in NAMES for _ in "XYZ")
        ),
    }.items():
        yield text("TRC", habit, content)
    for unit, factor in {
        "m": 1e-3,
        "cm": 0.1,
        "MM": 1,
        "Meters": 1e-3,
        "inches": 1 / 25.4,
    }.items():
        yield text("TRC", f"in {unit}", trc_text(POSITIONS * factor, NAMES, unit=unit))
    seen = motive(POSITIONS, NAMES)
    for habit, content in {
        "in m": motive(POSITIONS, NAMES, unit="Meters"),
        "in cm": motive(POSITIONS, NAMES, unit="Centimeters"),
        "version 1.25": seen.replace("1.23", "1.25").replace(
            ",,Rotation", ",Parent,\r\n,,Rotation", 1
        ),
        "a column of time codes": motive(POSITIONS, NAMES, code=True),
        "no unit": re.sub(r"Length Units,\w+,", "", seen),
        "no rate": re.sub(r"(Capture|Export) Frame Rate,[\d.]+,", "", seen),
        "a start": seen.replace(
            "Take Name", "Capture Start Time,2019-01-21 02.48.50.116 PM,Take Name"
        ),
        "no rigid bodies": re.sub(r"Rigid Body( Marker)?", "Bone", seen),
        "all unlabeled": seen.replace("Unlabeled 1042", "").replace(
            ",Marker,Marker,Marker\r", ",Bone,Bone,Bone\r"
        ),
    }.items():
        yield text("Motive", habit, content)
    for habit, content in {
        "trajectories alone": nexus(POSITIONS, NAMES, others=False),
        "no subject": nexus(POSITIONS, NAMES).replace("cat:", ""),
        "unlabelled trajectories": nexus(POSITIONS, (*NAMES[:4], "toe"), others=False),
        "names end early": nexus(POSITIONS, NAMES).replace(",,\nFrame", "\nFrame"),
        "in m": nexus(POSITIONS / 1000, NAMES).replace("mm", "m"),
        "model outputs first": nexus(POSITIONS, NAMES, others="first"),
        "blanks after the rate": nexus(POSITIONS, NAMES).replace(
            "\n100\n", "\n100 ,\n"
        ),
    }.items():
        yield text("Nexus", habit, content, names=NAMES)
    extra = np.concatenate([POSITIONS, POSITIONS[:, :2] + 7.0], axis=1)
    for kind in ("Nexus", "Workstation"):
        content = TEXTS[kind][2](extra, (*NAMES, "*113", "*114"))
        yield text(kind, "unlabelled beside labelled", content)
    people = deeplabcut(POSITIONS, NAMES, SCORES, individual="mouse1")
    named = tuple(f"mouse1 {name}" for name in NAMES)
    yield text("DeepLabCut", "an individual", people, names=named, given_hz=RATE)
    yield text(
        "DeepLabCut", "no likelihood", deeplabcut(POSITIONS, NAMES), given_hz=RATE
    )


def _of_binaries():  # noqa: C901 (a list of variants, one after the other)
    def keypoint_file(kind, habit, write, heads, values, names=NAMES):
        return Variant(
            kind, habit, ".h5", None, lambda p: write(p, heads, values), names, RATE
        )  # fmt: skip

    for kind, write in (("pandas rows", pandas_rows), ("pandas blocks", pandas_blocks)):
        for habit, names in NAMESETS.items():
            if habit == "repeated":
                continue
            scored, bare_names = columns(names), columns(names, score="")
            yield keypoint_file(
                kind, f"names {habit}", write, scored, table(POSITIONS, SCORES), names
            )
            yield keypoint_file(
                kind,
                f"names {habit}, no score",
                write,
                bare_names,
                table(POSITIONS),
                names,
            )
        who = tuple(f"m1 {name}" for name in NAMES)
        heads = columns(NAMES, individual="m1")
        yield keypoint_file(
            kind, "an individual", write, heads, table(POSITIONS, SCORES), who
        )
    bids = {
        "as it is": {}, "json above": {"above": True}, "a row of names": {"heads": True},
        "no latency": {"latency": False}, "points alone": {"extra": False},
        "z up": {"spatial": "ALS"}, "y up": {"spatial": "RUF"},
        "missing is NaN": {"missing": "NaN"}, "missing is -999": {"missing": "-999"},
    }  # fmt: skip
    for habit, options in bids.items():
        yield Variant(
            "Motion-BIDS", habit, "", None, _bids(POSITIONS, NAMES, **options)
        )
    for habit, names in NAMESETS.items():
        if habit not in ("repeated", "one empty"):  # which the standard excludes
            writer = _bids(POSITIONS, names)
            yield Variant("Motion-BIDS", f"names {habit}", "", None, writer, names)
    for unit, factor in {"m": 1e-3, "cm": 0.1}.items():
        writer = _bids(POSITIONS * factor, NAMES, unit=unit)
        yield Variant("Motion-BIDS", f"in {unit}", "", None, writer)
    for processor in ("Intel", "DEC", "MIPS"):
        for whole in (False, True):
            for habit, names in NAMESETS.items():
                yield _c3d(f"{processor}{', whole numbers' * whole}, names {habit}", names,
                           processor=processor, whole_numbers=whole)  # fmt: skip
    models = (
        "LHipAngles",
        "RKneeMoment",
        "LAnklePower",
        "LGroundReactionForce",
        "*113",
    )
    yield _c3d("model outputs without lists, and unlabelled", NAMES, more=models)
    event = {"USED": 2, "LABELS": ["strike"], "TIMES": np.array([[0.0, 0.05]], "<f4")}
    for habit, change in {
        "no unit": {"POINT": {"UNITS": None}},
        "events that do not fit": {"EVENT": event},
        "more labels than events": {"EVENT": {**event, "USED": 0}},
        "a rate of 0 in the parameters": {"POINT": {"RATE": np.float32(0)}},
        "axes of a screen": {"POINT": {"X_SCREEN": ["+X"], "Y_SCREEN": ["+Z"]}},
        "lists of outputs that are not there": {
            "POINT": {"ANGLES": ["LHip"], "POWERS": [""]}
        },
    }.items():
        yield _c3d(habit, NAMES, change=change)
    yield _c3d("frames from 101", NAMES, first=101)
    yield _c3d(
        "no labels", tuple("" for _ in NAMES), change={"POINT": {"LABELS": None}}
    )
    for unit, factor in {"m": 1e-3, "cm": 0.1, "MM": 1.0, "in": 1 / 25.4}.items():
        yield _c3d(f"in {unit}", NAMES, unit=unit, factor=factor)
    for habit, names in NAMESETS.items():
        struct = qtm_struct(np.nan_to_num(POSITIONS), names)
        for kind, write in (("MAT 5", write_mat5), ("MAT 7.3", write_mat73)):
            if habit != "one empty" and not (habit == "not ASCII" and kind == "MAT 5"):
                yield Variant(
                    kind, f"names {habit}", ".mat", None, _of(write, struct), names
                )
        if len(set(names)) == len(names) and all(names):
            roles = ("body",) * 3 + ("foot",) * 2
            own = Recording("trial", TIME, POSITIONS / 1000, names, roles, RATE)
            yield Variant(
                "our own",
                f"names {habit}",
                ".h5",
                None,
                _of(write_recording, own),
                names,
            )


def _bids(positions, names, **options):
    return lambda path: write_bids(path.parent / "motion", positions, names, **options)


def _of(write, content):
    return lambda path: write(path, content)


def _c3d(
    habit, names, *, more=(), unit="mm", factor=1.0, change=None, first=1, **options
):
    extra = np.repeat(POSITIONS[:, :1] + 5.0, len(more), axis=1)
    places = np.concatenate([POSITIONS, extra], axis=1) * factor
    time = TIME + (first - 1) / RATE
    raw = RawRecording((*names, *more), time, places, RATE, unit)

    def write(path):
        sound = written_files._groups
        with patch.object(
            written_files, "_groups", lambda *a: _changed(sound(*a), change or {})
        ):
            write_c3d(path, raw, **options)

    return Variant("C3D", habit, ".c3d", None, write, names)


def _changed(groups, change):
    """Replace parameters of groups, and remove those that are None."""
    merged = {
        **groups,
        **{g: {**groups.get(g, {}), **new} for g, new in change.items()},
    }
    return {
        group: {name: value for name, value in parameters.items() if value is not None}
        for group, parameters in merged.items()
    }
