"""Recordings as the tables of pandas and the labelled arrays of xarray, and back.

The functions here take and return the parts of a recording (`PARTS`), so that
`hopdata.Recording` can use them. On the way there and back no bit changes; only a wide
table does not tell which positions were filled.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, pd
from hopdata.errors import ArgumentError, RecordingError
from hopdata.time_stamps import RATE_TOLERANCE

#: Parts of a recording that are neither arrays nor names of markers.
PARTS = (
    *("name", "source", "source_sha256", "vertical_axis"),
    *("remarks", "events", "joined", "other_feet"),
)
#: Axes of a position; z points up.
AXES = ("x", "y", "z")
#: Dimensions of a dataset of poses, as in the package movement.
DIMENSIONS = ("time", "space", "keypoints", "individuals")
#: The only animal of a dataset, as movement names it.
INDIVIDUAL = "id_0"
#: Attribute of a table and of a dataset that holds `PARTS` as JSON.
ATTRIBUTE = "hopdata"
#: Columns of a long table that are no coordinates.
TIME = "time_s"
MARKER = "marker"
ROLE = "role"
FILLED = "filled"
COORDINATES = tuple(f"{axis}_m" for axis in AXES)

Parts = dict[str, Any]


def as_text(parts: Mapping[str, Any]) -> str:
    """Return the rate, the roles and `PARTS` as JSON, which any file can hold."""
    roles = dict(zip(parts["markers"], parts["roles"], strict=True))
    kept = {name: parts[name] for name in (*PARTS, "rate_hz")}
    return json.dumps({**kept, "roles": roles})


def _from_text(text: object) -> Parts:
    """Return what `as_text` has written; empty if there is nothing of it.

    The roles are by marker, as ``role_of``.
    """
    found: object = None
    if isinstance(text, str):
        with suppress(ValueError):
            found = json.loads(text)
    if not isinstance(found, dict):
        return {}
    role_of = found.pop("roles", None)
    return {**found, "role_of": role_of if isinstance(role_of, dict) else {}}


def rate_that_fits(time: FloatArray, rate_hz: object) -> float | None:
    """Return a stated rate, Hz, if the times (N,), s, are a step of it apart.

    Of a table in which rows were left out the rate is not what it was.
    """
    if not isinstance(rate_hz, int | float) or len(time) < 2:
        return None
    step_s = float(np.median(np.diff(time)))
    fits = abs(step_s * rate_hz - 1.0) <= RATE_TOLERANCE
    return float(rate_hz) if fits else None


# xarray.


def dataset_of(parts: Mapping[str, Any], individual: str) -> Any:
    """Return an ``xarray.Dataset`` of poses; see `hopdata.Recording.to_xarray`."""
    xarray = _xarray("to_xarray")
    positions = parts["positions"]
    n_frames, n_markers, _ = positions.shape
    # movement puts the axes before the keypoints.
    data: dict[str, Any] = {
        "position": (
            DIMENSIONS,
            np.swapaxes(positions, 1, 2)[..., None].copy(),
            {"units": "m", "long_name": "position"},
        ),
        "confidence": (
            ("time", "keypoints", "individuals"),
            np.full((n_frames, n_markers, 1), np.nan),
        ),
    }
    if parts["filled"] is not None:
        flags = parts["filled"][..., None].copy()
        data[FILLED] = (("time", "keypoints", "individuals"), flags)
    attributes = {
        "fps": float(parts["rate_hz"]),
        "time_unit": "seconds",
        "source_software": "hopdata",
        "source_file": parts["source"],
        "ds_type": "poses",
        ATTRIBUTE: as_text(parts),
    }
    coordinates: dict[str, Any] = {
        "time": ("time", parts["time"].copy(), {"units": "s"}),
        "space": list(AXES),
        "keypoints": list(parts["markers"]),
        "individuals": [individual],
        ROLE: ("keypoints", list(parts["roles"])),
    }
    return xarray.Dataset(data, coords=coordinates, attrs=attributes)


def parts_of_dataset(data: Any, individual: str | None) -> Parts:
    """Return the parts of the recording in a dataset, or in an array, of poses.

    Raises
    ------
    RecordingError
        If it is none, or has several individuals of which none is chosen.
    """
    xarray = _xarray("from_xarray")
    if not isinstance(data, xarray.Dataset | xarray.DataArray):
        wanted = "an xarray.Dataset or DataArray of positions"
        raise ArgumentError.at("data", wanted, type(data).__name__)
    attributes = dict(data.attrs)
    filled = None
    position = data
    if isinstance(data, xarray.Dataset):
        if "position" not in data:
            wanted = "a variable 'position', as of the package movement"
            raise RecordingError.at("data", wanted, ", ".join(map(str, data)) or "none")
        position = data["position"]
        filled = data.get(FILLED)
    position = _of_one(position, individual)
    missing = [name for name in DIMENSIONS[:3] if name not in position.dims]
    if missing or position.ndim != 3:
        wanted = f"the dimensions {', '.join(DIMENSIONS)}"
        raise RecordingError.at("data", wanted, ", ".join(map(str, position.dims)))
    _require_axes(position)
    position = position.sel(space=list(AXES)).transpose("time", "keypoints", "space")
    if filled is not None:
        filled = _of_one(filled, individual).transpose("time", "keypoints")
        filled = _flags(filled.to_numpy())
    roles = None
    if ROLE in position.coords:
        roles = [str(role) for role in position.coords[ROLE].to_numpy()]
    return {
        **_from_text(attributes.get(ATTRIBUTE)),
        "time": _seconds(position, attributes),
        "positions": np.array(position.to_numpy(), float),
        "markers": [str(name) for name in position["keypoints"].to_numpy()],
        "roles": roles,
        "filled": filled,
        "rate_hz": attributes.get("fps"),
    }


def _flags(values: np.ndarray) -> BoolArray:
    """Return what says of each position whether it was filled.

    Raises
    ------
    RecordingError
        If that is not said of each; a missing value would count as True.
    """
    if values.dtype != bool:
        others = [one for one in values.ravel() if one not in (True, False)]
        if others:
            wanted = "True or False for each position"
            raise RecordingError.at(FILLED, wanted, f"{others[0]!s}")
    return values.astype(bool)


def _of_one(array: Any, individual: str | None) -> Any:
    """Return the part of an array that is of one individual."""
    if "individuals" not in array.dims:
        return array
    names = [str(name) for name in array["individuals"].to_numpy()]
    if individual is None and len(names) > 1:
        wanted = f"one of {', '.join(names)}, since there are several"
        raise RecordingError.at("individual", wanted, "none")
    if individual is not None and individual not in names:
        wanted = f"one of {', '.join(names)}"
        raise RecordingError.at("individual", wanted, f"{individual!r}")
    return array.isel(individuals=names.index(individual) if individual else 0)


def _require_axes(position: Any) -> None:
    """Require positions in three dimensions, with names of the axes."""
    names: list[str] = []
    if "space" in position.coords:
        names = [str(name) for name in position["space"].to_numpy()]
    if sorted(names) != list(AXES):
        wanted = "the axes x, y and z of positions in m, z up"
        raise RecordingError.at("space", wanted, ", ".join(names) or "no names of axes")


def _seconds(position: Any, attributes: Mapping[str, Any]) -> FloatArray:
    """Return the times (N,), s; frames are counted at the rate of the attributes."""
    time = np.array(position["time"].to_numpy(), float)
    if attributes.get("time_unit", "seconds") == "seconds":
        return time
    fps = attributes.get("fps")
    if not fps:
        found = f"{attributes.get('time_unit')} without the attribute fps"
        raise RecordingError.at("time_unit", "seconds", found)
    return time / float(fps)


def _xarray(method: str) -> Any:
    try:
        import xarray
    except ImportError:
        raise RecordingError.at(
            method, "the package xarray", "none: pip install xarray"
        ) from None
    return xarray


# pandas.


def wide_table(parts: Mapping[str, Any]) -> pd.DataFrame:
    """Return a row for each frame, and columns of two levels: marker and axis."""
    n_frames, n_markers, _ = parts["positions"].shape
    levels = [list(parts["markers"]), list(AXES)]
    columns = pd.MultiIndex.from_product(levels, names=[MARKER, "axis"])
    table = pd.DataFrame(
        parts["positions"].reshape(n_frames, 3 * n_markers),
        index=pd.Index(parts["time"], name=TIME),
        columns=columns,
        copy=True,
    )
    table.attrs[ATTRIBUTE] = as_text(parts)
    return table


def long_table(parts: Mapping[str, Any]) -> pd.DataFrame:
    """Return a row for each frame and marker: ``time_s, marker, role, x_m, y_m, z_m``.

    Where gaps were filled, ``filled`` says so.
    """
    n_frames, n_markers, _ = parts["positions"].shape
    flat = parts["positions"].reshape(-1, 3)
    columns: dict[str, Any] = {
        TIME: np.repeat(parts["time"], n_markers),
        MARKER: list(parts["markers"]) * n_frames,
        ROLE: list(parts["roles"]) * n_frames,
    }
    for number, name in enumerate(COORDINATES):
        columns[name] = flat[:, number]
    if parts["filled"] is not None:
        columns[FILLED] = parts["filled"].ravel()
    table = pd.DataFrame(columns)
    table.attrs[ATTRIBUTE] = as_text(parts)
    return table


def parts_of_table(table: Any) -> Parts:
    """Return the parts of the recording in a wide or a long table.

    Raises
    ------
    RecordingError
        If it is neither.
    """
    if not isinstance(table, pd.DataFrame):
        raise ArgumentError.at("table", "a DataFrame", type(table).__name__)
    found = _from_text(table.attrs.get(ATTRIBUTE))
    found |= {FILLED: None, "roles": None}
    if table.columns.nlevels == 2:
        return {**found, **_of_wide(table)}
    missing = [one for one in (TIME, MARKER, *COORDINATES) if one not in table]
    if missing:
        wanted = (
            "columns of two levels, marker and axis, over an index of times, s; "
            f"or the columns {', '.join((TIME, MARKER, *COORDINATES))}"
        )
        raise RecordingError.at("table", wanted, f"none named {', '.join(missing)}")
    return {**found, **_of_long(table)}


def _of_wide(table: pd.DataFrame) -> Parts:
    pairs = [(str(column[0]), str(column[1])) for column in table.columns]
    markers = list(dict.fromkeys(marker for marker, _ in pairs))
    wanted = [(marker, axis) for marker in markers for axis in AXES]
    if sorted(pairs) != sorted(wanted):
        odd = sorted(set(wanted) ^ set(pairs)) or pairs
        found = ", ".join(" ".join(pair) for pair in odd[:3])
        raise RecordingError.at("table", "x, y and z of each marker once", found)
    order = [pairs.index(pair) for pair in wanted]
    numbers = table.to_numpy(float)[:, order]
    return {
        "time": np.array(table.index.to_numpy(), float),
        "positions": numbers.reshape(len(table), len(markers), 3),
        "markers": markers,
    }


def _of_long(table: pd.DataFrame) -> Parts:
    """Return the parts in a long table, whose rows may have any order.

    A marker without a row in a frame was not seen there.
    """
    time, frame = np.unique(table[TIME].to_numpy(float), return_inverse=True)
    number, names = pd.factorize(table[MARKER].astype(str))
    cell = frame * len(names) + number
    if len(np.unique(cell)) < len(cell):
        row = table[pd.Series(cell, table.index).duplicated()].iloc[0]
        wanted = "one row for each time and marker"
        found = f"several at {row[TIME]:g} s of {row[MARKER]}"
        raise RecordingError.at("table", wanted, found)
    positions = np.full((len(time) * len(names), 3), np.nan)
    positions[cell] = table[list(COORDINATES)].to_numpy(float)
    parts: Parts = {
        "time": time,
        "positions": positions.reshape(len(time), len(names), 3),
        "markers": [str(name) for name in names],
    }
    if FILLED in table:
        filled = np.zeros(len(positions), bool)
        filled[cell] = _flags(table[FILLED].to_numpy())
        parts[FILLED] = filled.reshape(len(time), len(names))
    if ROLE in table:
        firsts = np.unique(number, return_index=True)[1]
        parts["roles"] = [str(role) for role in table[ROLE].iloc[firsts]]
    return parts


def roles_of(parts: Mapping[str, Any], names: Sequence[str]) -> list[str]:
    """Return the roles that a table or dataset states for its markers, or ``other``.

    Those of a wide table stand beside it, for the markers that it had at first.
    """
    if parts["roles"] is not None:
        return list(parts["roles"])
    role_of = parts.get("role_of", {})
    return [str(role_of.get(name, "other")) for name in names]
