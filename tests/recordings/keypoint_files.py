"""Keypoints as DeepLabCut and Anipose write them: CSV, and the two layouts of HDF5 in pandas."""

import pickle

import h5py
import numpy as np
from csv_files import cells

SCORER = "DLC_3D"


def columns(names, *, score="likelihood", individual=None):
    """Return DeepLabCut's column names: scorer, perhaps an individual, body part, coordinate."""
    who = () if individual is None else (individual,)
    axes = ("x", "y", "z", score) if score else ("x", "y", "z")
    return [(SCORER, *who, name, axis) for name in names for axis in axes]


def table(positions, scores=None):
    """Return rows of numbers (N, K), with a score after each point if there are scores."""
    if scores is None:
        return positions.reshape(len(positions), -1)
    return np.concatenate([positions, scores[..., None]], axis=2).reshape(
        len(positions), -1
    )


def deeplabcut(positions, names, scores=None, **options):
    heads = columns(names, score="likelihood" if scores is not None else "", **options)
    levels = (
        "scorer",
        *(("individuals",) if len(heads[0]) == 4 else ()),
        "bodyparts",
        "coords",
    )
    lines = [
        ",".join([level, *row])
        for level, row in zip(levels, zip(*heads, strict=True), strict=True)
    ]
    lines += [f"{k},{cells(row)}" for k, row in enumerate(table(positions, scores))]
    return "\n".join(lines) + "\n"


def anipose(positions, names, scores):
    parts = ("x", "y", "z", "error", "ncams", "score")
    matrix = [f"M_{i}{j}" for i in range(3) for j in range(3)] + [
        f"center_{i}" for i in range(3)
    ]
    lines = [
        ",".join(
            [f"{name}_{part}" for name in names for part in parts] + [*matrix, "fnum"]
        )
    ]
    for k, (place, score) in enumerate(zip(positions, scores, strict=True)):
        points = [f"{cells(p)},1.2,3,{s}" for p, s in zip(place, score, strict=True)]
        lines.append(",".join([*points, "1,0,0,0,1,0,0,0,1,0,0,0", str(k)]))
    return "\n".join(lines) + "\n"


def pandas_rows(path, heads, values):
    """Write what ``to_hdf(..., format="table")`` writes: rows, with pickled column names beside."""
    rows = np.zeros(
        len(values), [("index", "<i8"), ("values_block_0", "<f8", (len(heads),))]
    )
    rows["index"], rows["values_block_0"] = np.arange(len(values)), values
    with h5py.File(path, "w") as file:
        group = file.create_group("df_with_missing")
        group.attrs["pandas_type"] = np.bytes_("frame_table")
        stored = group.create_dataset("table", data=rows, chunks=True, maxshape=(None,))
        stored.attrs["values_block_0_kind"] = np.bytes_(pickle.dumps(heads, 0))
    return path


def pandas_blocks(path, heads, values):
    """Write what ``to_hdf`` writes without a format: an array, levels and codes of the names."""
    with h5py.File(path, "w") as file:
        group = file.create_group("tracks")
        group.attrs["pandas_type"], group.attrs["nblocks"] = np.bytes_("frame"), 1
        group.attrs["block0_items_nlevels"] = len(heads[0])
        group["block0_values"] = values
        for k, level in enumerate(zip(*heads, strict=True)):
            known = sorted(set(level))
            group[f"block0_items_level{k}"] = np.array(
                [name.encode() for name in known]
            )
            group[f"block0_items_label{k}"] = np.array(
                [known.index(n) for n in level], "i1"
            )
    return path
