"""Small files of further programs: BVH, TRB, MVNX, Kinetics Toolkit, SLEAP, D-Flow, Excel, Theia.

Each writer takes positions (N, M, 3) in the unit that the format has by habit, NaN where a
marker is unseen, and returns bytes (or writes a file of HDF5).
"""

import io
import json
import struct
import zipfile
from xml.sax.saxutils import escape, quoteattr

import h5py
import numpy as np
from written_files import BLOCK, PROCESSORS, from_floats, from_whole, parameter_bytes

RATE = 100.0
DATE = (2021, 1, 1, 12, 0, 0)  # of members of zip files, so that bytes are the same


def bvh(positions, names, *, rate=RATE, digits=6, ends=(), order="ZXY", tab=False):
    """Return a BVH of a root and its children, all with position channels, without rotation.

    The last place of a child is its own minus that of the root. `ends` are offsets of ends
    of limbs, by the index of their joint.
    """
    lines = ["HIERARCHY"]
    rotations = " ".join(f"{axis}rotation" for axis in order)
    channels = f"CHANNELS 6 Xposition Yposition Zposition {rotations}"
    for k, name in enumerate(names):
        indent = "\t" if k else ""
        lines += [
            f"{indent}{'JOINT' if k else 'ROOT'} {name}",
            f"{indent}{{",
            f"{indent}\tOFFSET 0.000000 0.000000 0.000000",
            f"{indent}\t{channels}",
        ]
        if k in dict(ends):
            offset = " ".join(f"{x:.6f}" for x in dict(ends)[k])
            lines += ["\tEnd Site", "\t{", f"\t\tOFFSET {offset}", "\t}"]
        if k:
            lines.append(f"{indent}}}")
    lines += ["}", "MOTION", f"Frames: {len(positions)}"]
    lines.append(f"Frame Time: {1 / rate:.{digits}f}")
    relative = positions.copy()
    relative[:, 1:] -= positions[:, :1]
    rows = np.concatenate([relative, np.zeros_like(relative)], axis=2)
    mark = "\t" if tab else " "
    for row in rows.reshape(len(rows), 6 * len(names)):
        lines.append(mark.join(f"{x:.6f}" for x in row))
    return ("\n".join(lines) + "\n").encode()


def trb(positions, names, *, rate=RATE, first_s=0.0, first_frame=1, links=1):
    """Return a TRB: the header, a record for each marker and link, one for each frame."""
    head = b"\0\0\0\0\xff\xff\xff\xff"

    def record(key, content):
        content += b"\0" * (-len(content) % 4)
        return struct.pack("<HH", key, len(content) // 4) + content

    records = record(0x0101, struct.pack("<HH", 0, 7))
    records += record(0x0102, struct.pack("<HH", 0, 1))
    records += record(0x0103, struct.pack("<f", rate))
    records += record(0x0104, struct.pack("<f", rate))
    records += record(0x0105, struct.pack("<f", first_s))
    records += record(0x0115, struct.pack("<HH", 0, 0))
    for k, name in enumerate(names):
        text = name.encode("latin-1", "replace") + b"\0"
        records += record(0x010C, struct.pack("<HH", k + 1, 5) + text)
    for _ in range(links):
        records += record(0x010D, struct.pack("<HHH", 1, 1, 2) + b"link\0")
    data_start = len(head) + 4 + len(records)
    words = data_start // 4
    content = head + struct.pack("<HH", words >> 16, words & 0xFFFF) + records
    for frame, row in enumerate(positions):
        seen = [k for k in range(len(names)) if np.isfinite(row[k]).all()]
        n_words = (12 + 24 * len(seen)) // 4
        number = (frame + first_frame) % 65536
        content += struct.pack("<HHHHHH", 0, 0, 0x0600, number, n_words, 0)
        for k in seen:
            content += struct.pack("<HHffffI", k + 1, 0, *row[k], 0.5, 3)
    return content


def mvnx(positions, names, *, rate=RATE, poses=2, namespace=True, first=0, ms=True):
    """Return an MVNX: segments with points, poses, and frames with orientation and position."""
    begin = ' xmlns="http://www.xsens.com/mvn/mvnx"' if namespace else ""
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<mvnx{begin} version="4">',
        '<mvn version="2021.2" build="1"/>',
        "<comment>hop</comment>",
        f'<subject label="S1" frameRate="{rate:g}" segmentCount="{len(names)}" '
        'recDateMSecsSinceEpoch="1609502400000">',
        "<segments>",
    ]
    for k, name in enumerate(names):
        point = '<points><point label="jTop"><pos_b>0 0 0</pos_b></point></points>'
        lines.append(f'<segment label={quoteattr(name)} id="{k + 1}">{point}</segment>')
    lines += ["</segments>", f'<frames segmentCount="{len(names)}">']
    turn = " ".join(["1 0 0 0"] * len(names))

    def place(row):
        return " ".join("nan" if np.isnan(x) else f"{x:.6f}" for x in np.ravel(row))

    for k in range(poses):
        kind = ("identity", "tpose")[k % 2]
        lines.append(
            f'<frame type="{kind}" index="{k - 2}" time="0"><orientation>{turn}'
            f"</orientation><position>{place(positions[0])}</position></frame>"
        )
    for k, row in enumerate(positions):
        time = f' time="{1000 * k / rate:.0f}"' if ms else ""
        lines.append(
            f'<frame type="normal" index="{k + first}"{time}><orientation>{turn}'
            f"</orientation><position>{place(row)}</position></frame>"
        )
    lines += ["</frames>", "</subject>", '<securityCode code="x"/>', "</mvnx>", ""]
    return "\n".join(lines).encode()


def zipped(members):
    """Return a zip file of named texts, the same bytes each time."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, text in members.items():
            archive.writestr(zipfile.ZipInfo(name, DATE), text, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


def ktk_series(positions, names, *, rate=RATE, unit="m", events=()):
    """Return a time series as Kinetics Toolkit stores it in JSON."""
    data = {}
    for k, name in enumerate(names):
        fourth = np.where(np.isnan(positions[:, k]).any(axis=1), np.nan, 1.0)
        data[name] = np.column_stack([positions[:, k], fourth]).tolist()
    return {
        "class__": "ktk.TimeSeries",
        "time": (np.arange(len(positions)) / rate).tolist(),
        "time_info": {"Unit": "s"},
        "data_info": {name: {"Unit": unit} for name in names if unit},
        "data": data,
        "events": [{"name": name, "time": time} for name, time in events],
    }


def ktk(content):
    """Return what ``kineticstoolkit.save`` writes."""
    metadata = {"Software": "Kinetics Toolkit", "Version": "0.13.0"}
    return zipped(
        {"metadata.json": json.dumps(metadata), "data.json": json.dumps(content)}
    )


def sleap_analysis(path, positions, names, *, scores=None, dims=False, tracks=("m1",)):
    """Write SLEAP's analysis HDF5: axes of animals, coordinates, nodes, frames."""
    points = np.stack([positions] * len(tracks), axis=1)  # frames, tracks, nodes, xyz
    stored = points.transpose(1, 3, 2, 0)
    with h5py.File(path, "w") as file:
        file.create_dataset("tracks", data=stored, track_times=False)
        if dims:
            file["tracks"].attrs["dims"] = json.dumps(["track", "xy", "node", "frame"])
        file["track_occupancy"] = np.ones((len(positions), len(tracks)), np.uint8)
        file["node_names"] = np.array([name.encode() for name in names])
        file["track_names"] = np.array([name.encode() for name in tracks])
        if scores is not None:
            both = np.stack([scores] * len(tracks), axis=1)
            file["point_scores"] = both.transpose(1, 2, 0)
    return path


def sleap_csv(positions, names, *, scores=None, tracks=("m1",), axes="xyz"):
    """Return SLEAP's analysis CSV: a row for each animal in a frame."""
    scores = np.full(positions.shape[:2], 0.9) if scores is None else scores
    parts = [*axes, "score"]
    heads = [f"{name}.{part}" for name in names for part in parts]
    lines = [",".join(["track", "frame_idx", "instance.score", *heads])]
    for k, row in enumerate(positions):
        for track in tracks:
            cells = []
            for place, score in zip(row, scores[k], strict=True):
                numbers = place[: len(axes)]
                cells += ["" if np.isnan(x) else f"{x:.6f}" for x in numbers]
                cells.append(f"{score:g}")
            lines.append(",".join([track, str(k), "0.95", *cells]))
    return ("\n".join(lines) + "\n").encode()


def dflow(positions, names, *, rate=RATE, forces=True, held=True, first=1, mark="\t"):
    """Return D-Flow's table; an unseen marker keeps its last place."""
    heads = ["TimeStamp", "FrameNumber"]
    heads += [f"{name}.Pos{axis}" for name in names for axis in "XYZ"]
    if forces:
        heads += ["FP1.CopX", "FP1.CopY", "FP1.CopZ", "FP1.ForX", "FP1.ForY"]
    lines = [mark.join(heads)]
    last = np.zeros(positions.shape[1:])
    for k, row in enumerate(positions):
        is_seen = np.isfinite(row).all(axis=1)
        last = np.where(is_seen[:, None], row, last if held else 0.0)
        cells = [f"{k / rate:.6f}", str(k + first)]
        cells += [f"{x:.7f}" for x in np.ravel(last)]
        cells += ["0.1", "0.0", "0.2", "1.5", "700.2"] if forces else []
        lines.append(mark.join(cells))
    return ("\n".join(lines) + "\n").encode()


# A workbook of Excel, with texts in the cells themselves.

_TYPES = (
    '<?xml version="1.0" encoding="UTF-8" standalone="yes"?><Types xmlns="http://'
    'schemas.openxmlformats.org/package/2006/content-types"><Default Extension="rels" '
    'ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Default '
    'Extension="xml" ContentType="application/xml"/><Override PartName="/xl/workbook.xml"'
    ' ContentType="application/vnd.openxmlformats-officedocument.spreadsheetml.sheet.'
    'main+xml"/>{sheets}</Types>'
)
_TYPE = (
    '<Override PartName="/xl/worksheets/sheet{k}.xml" ContentType="application/vnd.'
    'openxmlformats-officedocument.spreadsheetml.worksheet+xml"/>'
)
_OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
_PACKAGE = "http://schemas.openxmlformats.org/package/2006/relationships"
_MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"


def xlsx(sheets):
    """Return a workbook of sheets: the name, and rows of texts and numbers."""
    numbered = list(enumerate(sheets, start=1))
    relations = f'<Relationships xmlns="{_PACKAGE}">'
    relations += "".join(
        f'<Relationship Id="rId{k}" Type="{_OFFICE}/worksheet" '
        f'Target="worksheets/sheet{k}.xml"/>'
        for k, _ in numbered
    )
    listed = "".join(
        f'<sheet name={quoteattr(name)} sheetId="{k}" r:id="rId{k}"/>'
        for k, name in numbered
    )
    members = {
        "[Content_Types].xml": _TYPES.format(
            sheets="".join(_TYPE.format(k=k) for k, _ in numbered)
        ),
        "_rels/.rels": f'<Relationships xmlns="{_PACKAGE}"><Relationship Id="rId1" '
        f'Type="{_OFFICE}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'<workbook xmlns="{_MAIN}" xmlns:r="{_OFFICE}"><sheets>'
        f"{listed}</sheets></workbook>",
        "xl/_rels/workbook.xml.rels": relations + "</Relationships>",
    }
    for k, name in numbered:
        members[f"xl/worksheets/sheet{k}.xml"] = _sheet(sheets[name])
    return zipped(members)


def _sheet(rows):
    body = []
    for number, row in enumerate(rows, start=1):
        cells = []
        for column, value in enumerate(row):
            place = f"{_letters(column)}{number}"
            if isinstance(value, str):
                text = f"<is><t>{escape(value)}</t></is>"
                if value:
                    cells.append(f'<c r="{place}" t="inlineStr">{text}</c>')
            elif np.isfinite(value):
                cells.append(f'<c r="{place}"><v>{value!r}</v></c>')
        body.append(f'<row r="{number}">{"".join(cells)}</row>')
    return (
        f'<worksheet xmlns="{_MAIN}"><sheetData>{"".join(body)}</sheetData></worksheet>'
    )


def _letters(column):
    first, second = divmod(column, 26)
    return (chr(64 + first) if first else "") + chr(65 + second)


def table_of(positions, names, *, rate=RATE, axes=("_x", "_y", "_z")):
    """Return the rows of a tidy table: names above, then time and coordinates."""
    heads = ["time", *(f"{name}{axis}" for name in names for axis in axes)]
    rows = [
        [k / rate, *(float(x) for x in np.ravel(row))]
        for k, row in enumerate(positions)
    ]
    return [heads, *rows]


# A C3D of rotations, as Theia3D writes it.


def theia(
    positions, names, *, points=None, ratio=1, unit="mm", rate=RATE, processor="Intel"
):
    """Return a C3D of segments whose origins are at positions, and perhaps of points.

    The first segment is the world, which never moves. `points` are names and positions.
    """
    kind = next(one for one in PROCESSORS.values() if one.name == processor)
    n_frames = len(positions)
    point_names, places = points or ((), np.zeros((n_frames, 0, 3)))
    labels = ["worldbody_4X4", *(f"{name}_4X4" for name in names)]

    def section(data_start, rotation_start):
        groups = {
            "POINT": {
                "USED": len(point_names),
                "SCALE": np.float32(-1),
                "RATE": np.float32(rate),
                "FRAMES": n_frames,
                "DATA_START": data_start,
                "UNITS": [unit],
                **({"LABELS": list(point_names)} if point_names else {}),
            },
            "ROTATION": {
                "LABELS": labels,
                "USED": len(labels),
                "RATE": np.float32(rate * ratio),
                "RATIO": ratio,
                "DATA_START": rotation_start,
            },
            "ANALOG": {"USED": 0},
        }
        return parameter_bytes(kind, groups)

    def padded(data):
        return data + b"\0" * (-len(data) % BLOCK)

    numbers = np.zeros((n_frames, len(point_names), 4))
    numbers[:, :, :3] = places
    of_points = padded(from_floats(kind, numbers)) if point_names else b"\0" * BLOCK
    start = 2 + len(section(1, 1)) // BLOCK
    turned = np.zeros((n_frames, ratio, len(labels), 17))
    turned[..., [0, 5, 10, 15]] = 1.0
    seen = np.isfinite(positions).all(axis=2)
    turned[:, :, 1:, 12:15] = positions[:, None]
    turned[:, :, 1:, 16] = np.where(seen, 0.0, -1.0)[:, None]
    words = [len(point_names), 0, 1, n_frames, 0]
    header = bytes([2, 0x50]) + from_whole(kind, words) + from_floats(kind, [-1.0])
    header += from_whole(kind, [start, 0]) + from_floats(kind, [rate])
    parameters = section(start, start + len(of_points) // BLOCK)
    rotations = padded(from_floats(kind, turned))
    return header.ljust(BLOCK, b"\0") + parameters + of_points + rotations


# A C3D of any shape: points, analog samples, parameters and a header that may be wrong.


def c3d(
    positions,
    names,
    *,
    unit="mm",
    rate=RATE,
    processor="Intel",
    whole=False,
    analog=None,
    seen_word=0.0,
    unseen_word=-1.0,
    unseen=0.0,
    first=1,
    groups=None,
    header=None,
):
    """Return a C3D file.

    `analog` (N, samples a frame, channels) stands behind the points of each frame. The
    residual words of points that were seen or not are as given, and so is what stands for
    the coordinates of the latter. `groups` changes parameters (None removes one), `header`
    the words of the header.
    """
    kind = next(one for one in PROCESSORS.values() if one.name == processor)
    n_frames, n_points = positions.shape[:2]
    samples = np.zeros((n_frames, 1, 0)) if analog is None else analog
    per_frame, n_channels = samples.shape[1:]
    largest = np.nanmax(np.abs(positions), initial=0.0) or 1.0
    scale = float(np.float32(largest / 32000)) if whole else -1.0

    def section(start):
        point = {
            "USED": n_points,
            "SCALE": np.float32(scale),
            "RATE": np.float32(rate),
            "DATA_START": start,
            "FRAMES": min(n_frames, 65535),
            "UNITS": [unit],
        }
        for k in range(0, max(n_points, 1), 255):
            key = "LABELS" if not k else f"LABELS{k // 255 + 1}"
            point[key] = list(names[k : k + 255]) or [""]
        channels = {"USED": n_channels, "RATE": np.float32(rate * per_frame)}
        if n_channels:
            channels["LABELS"] = [f"Fz{k + 1}" for k in range(n_channels)]
            channels["SCALE"] = np.ones(n_channels, "f4")
            channels["GEN_SCALE"] = np.float32(1)
            channels["OFFSET"] = np.zeros(n_channels, int)
        last = first + n_frames - 1
        trial = {
            "ACTUAL_START_FIELD": np.array([first % 65536, first // 65536]),
            "ACTUAL_END_FIELD": np.array([last % 65536, last // 65536]),
        }
        all_groups = {"POINT": point, "ANALOG": channels, "TRIAL": trial}
        for group, changes in (groups or {}).items():
            changed = {**all_groups.get(group, {}), **changes}
            all_groups[group] = {k: v for k, v in changed.items() if v is not None}
        return parameter_bytes(kind, all_groups)

    is_unseen = np.isnan(positions).any(axis=2)
    points = np.zeros((n_frames, n_points, 4))
    points[:, :, :3] = np.where(is_unseen[..., None], unseen, positions)
    points[:, :, 3] = np.where(is_unseen, unseen_word, seen_word)
    if whole:
        points[:, :, :3] /= scale
    rows = np.concatenate(
        [points.reshape(n_frames, -1), samples.reshape(n_frames, -1)], axis=1
    )
    data = from_whole(kind, np.round(rows)) if whole else from_floats(kind, rows)
    start = 2 + len(section(1)) // BLOCK
    words = {
        "points": n_points,
        "analog": per_frame * n_channels,
        "first": min(first, 65535),
        "last": min(first + n_frames - 1, 65535),
        "rate": rate,
        "start": start,
        **(header or {}),
    }
    lead = [words[key] for key in ("points", "analog", "first", "last")]
    block = bytes([2, 0x50]) + from_whole(kind, [*lead, 0]) + from_floats(kind, [scale])
    block += from_whole(kind, [words["start"], per_frame])
    block += from_floats(kind, [words["rate"]])
    data += b"\0" * (-len(data) % BLOCK)
    return block.ljust(BLOCK, b"\0") + section(start) + data
