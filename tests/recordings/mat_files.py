"""Writes MAT files as QTM exports them, with libraries that are independent of our reader."""

import h5py
import numpy as np
import scipy.io

STAMP = "2021-01-01, 12:00:00.000\t100.00000000"


def qtm_struct(positions, names, *, rate_hz=100.0, events=(), start=1, types=None):
    """Return the struct of an export; `positions` (N, M, 3) in mm."""
    n_frames, n_markers = positions.shape[:2]
    data = np.zeros((n_markers, 4, n_frames))
    data[:, :3] = np.moveaxis(positions, 0, 2)
    labels = np.empty((1, n_markers), object)
    labels[0] = names
    labelled = {"Count": float(n_markers), "Labels": labels, "Data": data}
    if types is not None:
        labelled["TrajectoryTypes"] = types
    fields = {
        "File": "trial.qtm",
        "Timestamp": STAMP,
        "StartFrame": float(start),
        "Frames": float(n_frames),
        "FrameRate": float(rate_hz),
        "Trajectories": {"Labeled": labelled},
    }
    if events:
        array = np.empty(
            (1, len(events)), [("Label", "O"), ("Frame", "O"), ("Time", "O")]
        )
        for i, (label, seconds) in enumerate(events):
            array[0, i] = (label, round(seconds * rate_hz) + 1, seconds)
        fields["Events"] = array
    return fields


def write_mat5(path, struct, *, name="trial", compressed=False):
    scipy.io.savemat(
        path, {name: struct}, do_compression=compressed, long_field_names=True
    )
    with path.open("r+b") as file:
        file.write(
            b"MATLAB 5.0 MAT-file".ljust(116)
        )  # without the date: the same bytes each time
    return path


def write_mat73(path, struct, *, name="trial"):
    """Write the struct in the layout of MATLAB 7.3: reversed axes, cells as references."""
    with h5py.File(path, "w", userblock_size=512) as file:
        _put(file, file.create_group("#refs#", track_order=True), name, struct)
    lead = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + b"\0" * 8 + b"\0\2IM"
    with path.open("r+b") as file:
        file.write(lead)
    return path


def _put(group, store, name, value):
    if isinstance(value, dict):
        inner = group.create_group(name)
        inner.attrs["MATLAB_class"] = np.bytes_("struct")
        for key, entry in value.items():
            _put(inner, store, key, entry)
    elif isinstance(value, str):
        codes = np.frombuffer(value.encode("utf-16-le"), "<u2").reshape(-1, 1)
        group.create_dataset(name, data=codes).attrs["MATLAB_class"] = np.bytes_("char")
    elif isinstance(value, np.ndarray) and value.dtype == object:
        group.create_dataset(name, data=_references(store, value.ravel()))
        group[name].attrs["MATLAB_class"] = np.bytes_("cell")
    elif isinstance(value, np.ndarray) and value.dtype.names:
        inner = group.create_group(name)
        for key in value.dtype.names:
            inner.create_dataset(key, data=_references(store, value[key].ravel()))
    else:
        array = np.atleast_2d(np.asarray(value, float))
        group.create_dataset(name, data=array.T).attrs["MATLAB_class"] = np.bytes_(
            "double"
        )


def _references(store, values):
    references = np.empty((len(values), 1), h5py.ref_dtype)
    for i, value in enumerate(values):
        key = f"r{len(store)}"
        _put(store, store, key, value)
        references[i, 0] = store[key].ref
    return references
