"""Motion-BIDS files: rows of numbers, with channels and JSON beside them."""

import json

import numpy as np

NAME = "sub-01_task-hop_tracksys-optical_run-1"
AXES = ("x", "y", "z")


def write_bids(
    folder, positions, names, *, unit="mm", rate=100.0, latency=True, spatial="", missing="n/a",
    heads=False, above=False, extra=True,
):  # fmt: skip
    """Write a file with its companions and return its path; `above` puts the JSON one folder up."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [(f"{n}_{a}", a, "POS", n, unit) for n in names for a in AXES]
    rows += [("quat_x", "quat_x", "ORNT", names[0], "n/a")] * extra
    rows += [("latency", "n/a", "LATENCY", "n/a", "s")] * latency
    head = ("name", "component", "type", "tracked_point", "units")
    lines = ["\t".join(row) for row in (head, *rows)]
    (folder / f"{NAME}_channels.tsv").write_text(
        "\n".join(lines) + "\n", encoding="utf-8"
    )
    told = {"SamplingFrequency": rate, "MissingValues": missing, "TaskName": "hop"}
    place = (
        folder.parent / "task-hop_motion.json"
        if above
        else folder / f"{NAME}_motion.json"
    )
    place.write_text(json.dumps(told))
    if spatial:
        frame = {"reference_frame": {"Levels": {"global": {"SpatialAxes": spatial}}}}
        (folder / f"{NAME}_channels.json").write_text(json.dumps(frame))
    numbers = [
        [missing if np.isnan(x) else f"{x:.6f}" for x in row.ravel()]
        for row in positions
    ]
    for k, cells in enumerate(numbers):
        cells += ["0.5"] * extra + [f"{k / rate:.5f}"] * latency
    body = [[row[0] for row in rows]] * heads + numbers
    path = folder / f"{NAME}_motion.tsv"
    path.write_text("\n".join("\t".join(cells) for cells in body) + "\n")
    return path
