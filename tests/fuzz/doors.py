"""Every door by which foreign data enters: sound inputs, what reads them, what must hold.

A door is a name, its sound inputs (by the name of their file) and a function that takes
the path of an input and returns what hopdata makes of it. The input lies in a folder of
its own, with its companions, and is called `input` where the name is free.
"""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

import damage
import numpy as np
from external_blocks import block, columns
from plate_files import PlateFile, Stance, write_plates
from qtm_files import NAMES, standing

from hopdata.recording import Recording
from hopdata.recordings.raw import RawRecording
from hopdata.seal import seal_for

N_FRAMES = damage.N_FRAMES


def nothing(_):
    """Ask nothing of a result."""


@dataclass(frozen=True)
class Door:
    """A place where foreign data enters.

    Attributes
    ----------
    make : callable
        Returns the sound inputs: the bytes by the name of their file.
    enter : callable
        Takes the path of an input.
    check : callable
        Takes the result; raises AssertionError if it cannot be.
    put : callable, optional
        Writes an input with its companions; returns the path to enter with.
    names_file : bool
        Whether errors must name a file of the folder.
    names : tuple of str
        What an error may name instead.
    loads_pickles : bool
        Whether it loads pickles of its own: the cache of machine code.
    in_ci : int
        Number of damaged inputs in CI, beside the hostile ones.
    """

    make: Callable[[], dict[str, bytes]]
    enter: Callable[[Path], Any]
    check: Callable[[Any], None] = nothing
    put: Callable[[Path, str, bytes], Path] | None = None
    names_file: bool = True
    names: tuple[str, ...] = ()
    loads_pickles: bool = False
    in_ci: int = 20

    @property
    def sound(self):
        """The sound inputs."""
        return _sound(self.make)

    def place(self, folder, name, data):
        """Write an input into an empty folder; return the path to enter with."""
        if self.put is not None:
            return self.put(folder, name, data)
        path = folder / f"input{name[name.index('.') :]}"
        path.write_bytes(data)
        return path


@cache
def _sound(make):
    return make()


# Recordings of every format.


@cache
def _recordings():
    return damage.corpus()


def _with(*endings):
    """Return a function for the sound recordings whose names end so."""

    @cache
    def make():
        return {k: v for k, v in _recordings().items() if k.endswith(endings)}

    return make


def _put_bids(folder, name, data):
    """Write one of the files of a recording of several."""
    return damage.placed(folder, name, data)


def _is_recording(found):
    """Require a recording that can be: its parts fit, its times increase."""
    if not isinstance(found, Recording):
        return
    positions = found.positions
    assert positions.shape == (len(found.time), len(found.markers), 3)
    assert positions.dtype == np.float64
    assert np.isfinite(found.time).all()
    assert (np.diff(found.time) > 0).all()
    assert not np.isinf(positions).any()
    assert np.isfinite(found.rate_hz)
    assert found.rate_hz > 0
    assert len(set(found.markers)) == len(found.markers)
    assert all(name.isprintable() for name in found.markers), found.markers
    assert len(found.roles) == len(found.markers)


def _import(path):
    from hopdata.recordings.importing import import_recording
    from hopdata.recordings.plausibility import check_plausible

    rate_hz = None
    begin = path.read_bytes()[:400]
    stateless = (b"EXT", b"scorer", b"ncams", b"frame_idx")
    if path.suffix in (".h5", ".hdf5") or any(word in begin for word in stateless):
        rate_hz = 100.0
    markers = damage.MARKERS
    recording, _ = import_recording(
        path, name="trial", markers=markers, rate_hz=rate_hz
    )
    check_plausible(recording)
    return recording


def _own_recordings():
    """Return recordings as a study keeps them: sealed, with a truth or without."""
    from hopdata.recordings.readers.hdf5 import write_recording

    roles = ("body",) * 3 + ("foot",) * 2
    time = np.arange(N_FRAMES) / 100
    own = Recording("trial", time, standing(N_FRAMES) / 1000, NAMES, roles, 100.0)
    with TemporaryDirectory() as folder:
        path = Path(folder, "own.h5")
        write_recording(path, own)
        sealed = path.read_bytes()
        unsealed = _without_seal(path)
        truth = Path(folder, "truth.h5")
        write_recording(truth, own, truth=_truth())
        with_truth = _without_seal(truth)
    return {"sealed.h5": sealed, "unsealed.h5": unsealed, "truth.h5": with_truth}


def _without_seal(path):
    """Return a file without its checksum, or no damage would reach the library."""
    return path.read_bytes()[: -len(seal_for(path))]


def _truth():
    from hopdata.truth import Truth

    return Truth(
        contact_times=np.full((2, 2), 0.1),
        apex_times=np.array([0.0, 0.1]),
        complete=np.ones(2, bool),
        foot_down=np.ones((N_FRAMES, 2), bool),
        body_height=np.ones(N_FRAMES),
        contact_points=np.zeros((2, 2, 2)),
        floor_at_contacts=np.zeros((2, 2)),
        apex_states=np.zeros((2, 12)),
        preloads_n=np.zeros((2, 2)),
        noise_m=0.001,
        parameters_json="{}",
    )


def _own_recording(path):
    from hopdata.recordings.readers.hdf5 import holds_truth, read_recording, read_truth

    recording = read_recording(path)
    read_truth(path)
    holds_truth(path, body=NAMES[:3], feet=NAMES[3:])
    return recording


# Contacts and forces of other devices.


def _raw():
    time = np.arange(N_FRAMES) / 100
    return RawRecording(NAMES, time, standing(N_FRAMES), 100.0, "mm", stated_up="z")


def _plates():
    n_samples = 4 * N_FRAMES
    push = np.zeros((n_samples, 3))
    push[20:60, 2] = 700.0
    place = np.tile([200.0, 300.0, 0.0], (n_samples, 1))
    stance = Stance(push, place, np.zeros(n_samples))
    found = {}
    with TemporaryDirectory() as folder:
        for kind in (1, 2, 3, 4):
            path = Path(folder, f"type{kind}.c3d")
            units = ["N"] * 6 if kind == 4 else None
            write_plates(path, _raw(), [stance], PlateFile(kind, units=units))
            found[path.name] = path.read_bytes()
    return found


def _read_plates(path):
    from hopdata.errors import RecordingError
    from hopdata.recordings.force_plates import read_force_plates

    try:
        read_force_plates(path, vertical_axis="z")
    except RecordingError:
        _read_forces(path)
        raise
    return _read_forces(path)


def _forces():
    head = "time\tground_force_vy\tother\n"
    rows = [f"{k / 1000:.4f}\t{700 * (k % 9):.3f}\t1" for k in range(N_FRAMES)]
    bare = head + "\n".join(rows) + "\n"
    return {
        "forces.mot": _recordings()["forces.mot"],
        "forces.txt": bare.encode(),
        "forces.csv": bare.replace("\t", ",").encode(),
    }


def _read_forces(path):
    from hopdata.recordings.external import read_force_signals

    name = "a1" if path.suffix == ".c3d" else damage.FORCE
    given = {"columns": columns(**{name: ["toe"]})}
    if path.suffix in (".txt", ".csv"):
        given["time_column"] = "time"
    options = block("forces", file=str(path), **given)
    return read_force_signals(options, feet=("toe",))


def _are_signals(signals):
    for signal in signals:
        assert np.isfinite(signal.time).all()
        assert (np.diff(signal.time) > 0).all()
        assert len(signal.time) == len(signal.force)


def _contacts():
    labelled = "label\ttime\nheel\t0.1\ntoe\t0.2\nheel\t0.7\n"
    wide = "heel,toe\n0.1,0.2\n0.7,\n"
    return {"labelled.tsv": labelled.encode(), "wide.csv": wide.encode()}


def _read_contacts(path):
    from hopdata.recordings.external import read_contact_times

    given = {}
    if path.suffix == ".tsv":
        given = {"label_column": "label", "time_column": "time"}
    options = block("contacts", file=str(path), **given)
    return read_contact_times(options, feet=("heel", "toe"))


def _are_contacts(found):
    for one in found:
        assert np.isfinite(one.instant).all()
        assert (np.diff(one.instant) >= 0).all()


# Configurations, groups and provenance.

CONFIG = """
study: sample
seed: 7
recordings:
  - name: hopper
    file: input.h5
    contacts: {file: contacts.csv, unit: ms}
markers:
  body: [body1, body2, body3]
  feet: [foot1, foot2]
input:
  unit: auto
  rate_hz: 100
verdict:
  margin: 0.2
  confidence: 0.95
simulation:
  hops: 20
"""


def _configs():
    printed = CONFIG.replace("seed: 7", "seed: 7\nprinted: true")
    aliases = CONFIG.replace("  unit: auto\n", "  <<: {unit: auto}\n")
    aliases = aliases.replace("seed: 7", "seed: &seed 7").replace(
        "hops: 20", "hops: *seed"
    )
    return {
        "plain.yaml": CONFIG.encode(),
        "printed.yaml": printed.encode(),
        "aliases.yaml": aliases.encode(),
    }


def _load_config(path):
    from hopdata.config.loading import load_config

    return load_config(path, check_files=False)


def _is_config(config):
    assert isinstance(config, dict)
    assert isinstance(config["study"], str)
    assert isinstance(config["seed"], int)
    study = config["study"]
    assert study == os.path.basename(study), study
    json.dumps(config, allow_nan=False)


def _groups():
    table = "subject\tcondition\tfile\tmass\nanna\tbare\ta.h5\t60\nben\tbare\tb.h5\t\n"
    config = CONFIG[: CONFIG.index("recordings:")] + "samples: input.tsv\n"
    config += CONFIG[CONFIG.index("markers:") :]
    return {"samples.tsv": table.encode(), "group.yaml": config.encode()}


def _put_group(folder, name, data):
    """Write a group's configuration and its table, one of them as given."""
    for sound, content in _sound(_groups).items():
        suffix = sound[sound.index(".") :]
        given = data if name.endswith(suffix) else content
        (folder / f"input{suffix}").write_bytes(given)
    return folder / "input.yaml"


def _read_group(path):
    from hopdata.samples import read_group

    return read_group(path)


def _is_group(group):
    for name, member in group["members"].items():
        assert name == os.path.basename(name), name
        assert name.isprintable(), name
        json.dumps(member, allow_nan=False)


def _provenances():
    import yaml

    from hopdata import __version__

    record = {
        "study": "sample",
        "seed": 7,
        "config": yaml.safe_load(CONFIG),
        "inputs": {"hopper": "0" * 64},
        "code_sha256": "0" * 64,
        "versions": {"hopdata": __version__},
    }
    return {"provenance.json": json.dumps(record, indent=1).encode()}


def _run_again(path):
    """Repeat the study of a provenance, up to where the workflow would start."""
    from hopdata.commands import run

    with mock.patch.object(run, "run_workflow", return_value=1):
        return _command("run", "--from", path.name)


def _command(*arguments):
    """Run the command line; raise the error that it prints."""
    from hopdata import __main__ as command_line
    from hopdata.errors import HopdataError

    told = []
    with mock.patch.object(command_line.sys, "stderr", _Lines(told)):
        code = command_line.main([str(one) for one in arguments])
    assert code in (0, 1), code
    for line in told:
        assert line.isprintable(), line
    errors = [line for line in told if line.startswith("hopdata: error: ")]
    if errors:
        raise HopdataError(*told[told.index(errors[0]) :])
    return code


class _Lines:
    """A stream that keeps the lines written to it."""

    def __init__(self, lines):
        self._lines = lines

    def write(self, text):
        self._lines += [line for line in text.splitlines() if line]

    def flush(self):
        """Keep nothing back."""

    def isatty(self):
        """Be no terminal, so that no line is drawn over another."""
        return False


def _inspect(path):
    return _command("inspect", path.name, "--rate", "100")


# What a study saved, and models.


def _saved():
    from hopdata.landings.states.pairs import Pairs, write_pairs

    rng = np.random.default_rng(np.random.SeedSequence(2))
    x, y = rng.standard_normal((2, 6, 18))
    pairs = Pairs(
        x=x,
        y=y,
        schedule=np.array(["12", "21"] * 3),
        spread_s=np.full(6, 1e-3),
        recording=np.array(["a"] * 6),
        touchdown=np.arange(6) + 1,
        body_markers=NAMES[:3],
        time_s=np.arange(6.0),
    )
    with TemporaryDirectory() as folder:
        path = Path(folder, "pairs.h5")
        write_pairs(path, pairs)
        return {"sealed.h5": path.read_bytes(), "unsealed.h5": _without_seal(path)}


def _read_pairs(path):
    from hopdata.landings.states.pairs import read_pairs

    return read_pairs(path)


def _are_pairs(pairs):
    assert pairs.x.shape == pairs.y.shape
    assert pairs.x.ndim == 2
    assert pairs.x.shape == (len(pairs), 6 * len(pairs.body_markers))


def _tables():
    units = {"length_m": 0.3, "time_s": 0.2}
    table = "recording,touchdown,schedule,time_s\nhopper,0,12,0.25\nhopper,1,21,0.75\n"
    return {
        "units.json": json.dumps(units).encode(),
        "touchdowns.csv": table.encode(),
    }


def _read_saved(path):
    from hopdata.jobs import read_json, read_table

    if path.suffix == ".json":
        return read_json(path)
    return read_table(path)


def _models():
    from hopdata.steering.frame_changes import HOPPER
    from hopdata.steering.models.process import FrameChangeProcess
    from hopdata.steering.models.process_file import save_process

    rng = np.random.default_rng(np.random.SeedSequence(1))
    turns = rng.uniform(-1.1, 1.1, (9, 2))
    process = FrameChangeProcess(
        smoothness=1.5,
        periodic=True,
        axes=HOPPER,
        points=turns,
        outputs=rng.standard_normal((9, 3)),
        offset=np.zeros(3),
        unit=np.ones(3),
        variance=np.ones(3),
        noise=np.full(3, 0.05),
        length_scales=np.ones((3, 2)),
    )
    with TemporaryDirectory() as folder:
        path = Path(folder, "model.npz")
        save_process(path, process)
        return {"model.npz": path.read_bytes()}


def _load_model(path):
    from hopdata.steering.models.process_file import load_process

    return load_process(path)


def _is_model(model):
    assert model.points.dtype == np.float64
    for name in ("points", "outputs", "offset", "unit", "variance", "noise"):
        assert np.isfinite(getattr(model, name)).all(), name


def _logs():
    from hopdata.steering.live.log import DriveLog

    with TemporaryDirectory() as folder:
        path = Path(folder, "drive.h5")
        log = DriveLog(path, 3, setup={"to": [0, 0]}, files={"a.txt": b"content"})
        log.start(lambda: None)
        log.close(1.0, {})
        return {"drive.h5": path.read_bytes()}


def _read_log(path):
    from hopdata.steering.live.log_reading import read_log

    return read_log(path)


# Packets of a live stream, and its settings.

LABELS = ("body1", "boom")


def _packets():
    from loopback_server import StreamFrame, event, frame_3d

    frames = [StreamFrame(k / 100, k, np.full((2, 3), 0.5)) for k in range(1, 5)]
    plain = b"".join(map(frame_3d, frames))
    residuals = b"".join(frame_3d(one, residuals=True) for one in frames)
    return {
        "plain.packets": plain + event(3),
        "residuals.packets": residuals + event(4),
    }


def _take_packets(path):
    """Push a stream through the line, in pieces, to the library's own client."""
    import asyncio

    return asyncio.run(_taken(path.read_bytes()))


async def _taken(data):
    import asyncio

    from qtm_rt.packet import QRTPacket
    from qtm_rt.protocol import QTMProtocol

    from hopdata.steering.live.packets import Line

    seen, faults = [], []

    def on_packet(packet):
        assert isinstance(packet, QRTPacket)
        seen.append(packet.get_3d_markers() or packet.get_3d_markers_residual())

    client = QTMProtocol(loop=asyncio.get_running_loop(), on_event=seen.append)
    client.set_on_packet(on_packet)
    line = Line(faults.append)
    line._client = client
    line.connection_made(mock.Mock())
    step = max(1, len(data) // 3)
    for at in range(0, len(data), step):
        line.data_received(data[at : at + step])
    if line.error is not None:
        raise line.error
    for fault in faults:
        assert fault.isprintable(), fault
    return seen


def _settings():
    from loopback_server import parameters_xml

    return {"all.xml": parameters_xml(LABELS, 100.0, parts=["all"]).encode()}


def _take_settings(path):
    from hopdata.steering.live.packets import (
        check_settings,
        find_labels,
        read_parameters,
    )

    parameters = read_parameters(path.read_bytes())
    check_settings(parameters, 100.0)
    find_labels(LABELS, parameters.labels)
    return parameters


def _are_settings(parameters):
    rate_hz = parameters.rate_hz
    assert rate_hz is None or (np.isfinite(rate_hz) and rate_hz > 0), rate_hz


# Machine code that was kept.

SOURCE = "def tripled(x):\n    return 3.0 * x\n"


def _codes():
    """Return the files of the cache of a small function: its index and its code."""
    with TemporaryDirectory() as folder:
        _tripled(Path(folder))
        files = [one for one in sorted(Path(folder).rglob("*.nb?")) if one.is_file()]
        return {_short(one): one.read_bytes() for one in files}


def _short(file):
    return f"code{file.suffix}"


def _tripled(folder):
    """Return a function compiled with its cache in this folder."""
    from hopdata.code_cache import kept_njit

    source = folder / "tripled.py"
    if not source.exists():
        source.write_text(SOURCE)
        os.utime(source, (1e9, 1e9))  # an index is valid for one time of its source
    names: dict[str, Any] = {}
    exec(compile(SOURCE, str(source), "exec"), names)
    return kept_njit("float64(float64)")(names["tripled"])


def _put_code(folder, name, data):
    """Fill a cache, with one of its files as given."""
    _tripled(folder)
    for one in sorted(folder.rglob(f"*{Path(name).suffix}")):
        one.write_bytes(data)
    return folder


def _run_code(folder):
    with _no_messages():
        return _tripled(folder)(14.0)


def _no_messages():
    import logging

    return mock.patch.object(logging.getLogger("hopdata"), "disabled", True)


def _is_right(found):
    assert found == 42.0, found


# Readers of other packages.


def _plugins():
    return {f"kind{kind}.odd": bytes([kind, 1]) for kind in (11, 0, 2, 6)}


def _read_with_plugin(path):
    from importlib.metadata import EntryPoint

    from hopdata.recordings.readers import formats

    plugin = EntryPoint(".odd", "doors:odd_reader", "hopdata.readers")
    with mock.patch.object(formats, "_others", return_value={".odd": plugin}):
        return _import(path)


ODD_ERRORS = (KeyError, RecursionError, ZeroDivisionError, UnicodeError, OSError)


def odd_reader(path, _):
    """Read a file as a bad package may: its first byte chooses what is wrong."""
    choices = np.frombuffer(path.read_bytes().ljust(8, b"\0")[:8], np.uint8)
    kind = int(choices[0]) % 12
    rng = np.random.default_rng(np.random.SeedSequence(choices.tolist()))
    raw = _raw()
    time, positions, markers = raw.time.copy(), raw.positions.copy(), list(raw.markers)
    if kind == 0:
        raise ODD_ERRORS[int(rng.integers(len(ODD_ERRORS)))]("\x1b[2Jodd\nerror")
    if kind == 1:
        return rng.choice(np.array([None, 3, "x"], object))
    odd = {
        2: {"time": time[::-1].copy()},
        3: {"time": np.full(len(time), np.nan)},
        4: {"positions": positions[:, :, :2]},
        5: {"positions": positions * np.inf},
        6: {"markers": ("\x1b[31m", *markers[1:])},
        7: {"markers": (markers[0],) * len(markers)},
        8: {"rate_hz": float(rng.choice([0.0, -1.0, np.nan, np.inf]))},
        9: {"unit": "\u202eft"},
        10: {"markers": None},
    }.get(kind, {})
    fields = {**vars(raw), "time": time, "positions": positions, **odd}
    return RawRecording(**fields)


def _read_only(endings, **options):
    return Door(_with(*endings), _import, _is_recording, **options)


#: Each door by its name.
DOORS = {
    "c3d": _read_only([".c3d"], in_ci=24),
    "tables": _read_only([".tsv", ".txt", ".csv"], put=_put_bids, in_ci=36),
    "trc": _read_only([".trc"]),
    "trb": _read_only([".trb"]),
    "bvh": _read_only([".bvh"]),
    "mvnx": _read_only([".mvnx"]),
    "mat": _read_only([".mat"], in_ci=24),
    "hdf5": _read_only([".h5"], in_ci=16),
    "ktk": _read_only([".ktk.zip"]),
    "xlsx": _read_only([".xlsx"], in_ci=8),
    "bids": _read_only([".json"], put=_put_bids, in_ci=6),
    "own": Door(_own_recordings, _own_recording, _is_recording, in_ci=10),
    "plates": Door(_plates, _read_plates, _are_signals),
    "forces": Door(_forces, _read_forces, _are_signals),
    "contacts": Door(_contacts, _read_contacts, _are_contacts),
    "config": Door(_configs, _load_config, _is_config, in_ci=30),
    "group": Door(
        _groups,
        _read_group,
        _is_group,
        put=_put_group,
        names=("samples: ",),  # which may be in a file that does not exist
        in_ci=18,
    ),
    "provenance": Door(_provenances, _run_again, in_ci=16),
    "pairs": Door(_saved, _read_pairs, _are_pairs, in_ci=10),
    "saved": Door(_tables, _read_saved, in_ci=10),
    "model": Door(_models, _load_model, _is_model),
    "log": Door(_logs, _read_log, in_ci=4),
    "packets": Door(_packets, _take_packets, names_file=False, in_ci=24),
    "settings": Door(_settings, _take_settings, _are_settings, names_file=False),
    "code": Door(
        _codes, _run_code, _is_right, put=_put_code, loads_pickles=True, in_ci=8
    ),
    "plugin": Door(_plugins, _read_with_plugin, _is_recording),
    "inspect": Door(_with("whole.tsv", "intel.c3d", "nexus.csv"), _inspect, in_ci=6),
}
