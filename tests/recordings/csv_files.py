"""CSV files as OptiTrack Motive and Vicon Nexus write them."""

import numpy as np


def cells(values):
    return ",".join("" if np.isnan(v) else f"{v:.6f}" for v in np.ravel(values))


def motive(
    positions,
    names,
    *,
    unit="Millimeters",
    version="1.23",
    rate=100.0,
    kind="Marker",
    code=False,
):
    """Return Motive's text, whose two rigid-body blocks come before the solved markers."""
    scale = {"Millimeters": 1.0, "Centimeters": 0.1, "Meters": 1e-3}[unit]
    head = (
        f"Format Version,1.23,Take Name,monday,Capture Frame Rate,{rate:.6f},"
        f"Export Frame Rate,{rate:.6f},Total Exported Frames,{len(positions)},"
        f"Rotation Type,Quaternion,Length Units,{unit},Coordinate Space,Global"
    )
    own = ["Rigid Body"] * 8 + ["Rigid Body Marker"] * 3
    called = ["pelvis"] * 8 + ["pelvis:Marker1"] * 3
    parts = (
        ["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"] + ["Position"] * 3
    )
    axes = [*"XYZW", *"XYZ", "", *"XYZ"]
    own += [kind] * 3 * len(names) + ["Marker"] * 3
    called += [name for name in names for _ in range(3)] + ["Unlabeled 1042"] * 3
    parts += ["Position"] * 3 * (len(names) + 1)
    axes += [*"XYZ"] * (len(names) + 1)
    lead = ["Frame", "Time (Seconds)"] + ["TimeCode"] * code
    blank = [""] * code
    lines = [head, ""]
    lines += [
        ",".join(["", label, *blank, *row])
        for label, row in (("Type", own), ("Name", called))
    ]
    lines += [",".join(["", "ID", *blank, *(f'"{k:X}"' for k in range(len(own)))])]
    lines += [",".join(["", "", *blank, *parts]), ",".join([*lead, *axes])]
    for frame, place in enumerate(positions * scale):
        extra = [f"15:26:{frame:02d}.02"] * code
        rigid = "0.1,0.2,0.3,0.9,1,2,3,0.01,7,8,9"
        row = [str(frame), f"{frame / rate:.6f}", *extra, rigid, cells(place), ",,"]
        lines.append(",".join(row))
    return "\r\n".join(lines) + "\r\n"


def nexus(positions, names, *, subjects=("cat",), others=True):
    names = [f"{subject}:{name}" for subject in subjects for name in names]
    lines = [
        "Devices",
        "1000",
        ",,Force,,",
        "Frame,Sub Frame,Fx,Fy,Fz",
        ",,N,N,N",
        "1,0,1,2,3",
        "",
    ]
    lines = lines if others else []
    lines += ["Trajectories", "100", ",," + ",,,".join(names) + ",,"]
    lines += [
        "Frame,Sub Frame" + ",X,Y,Z" * len(names),
        ",," + ",".join(["mm"] * 3 * len(names)),
    ]
    for frame, place in enumerate(positions):
        lines.append(f"{frame + 1},0,{cells(np.tile(place, (len(subjects), 1)))}")
    models = [
        "Model Outputs",
        "100",
        ",,cat:Angle,,",
        "Frame,Sub Frame,X,Y,Z",
        "1,0,1,2,3",
    ]
    if others == "first":
        return "\n".join([*models, "", *lines]) + "\n"
    return "\n".join([*lines, "", *models] if others else lines) + "\n"
