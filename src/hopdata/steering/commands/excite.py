"""``hopdata drive --excite``: record what a model is learned from; ``hopdata learn``.

The folder that the first writes has the tables of a study's model. The second adds the
model, and ``hopdata drive --model`` takes the folder.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hopdata.commands import terminal
from hopdata.errors import AnalysisError, ConfigError, counted, require

if TYPE_CHECKING:
    from hopdata.arrays import FloatArray
    from hopdata.steering.live.decisions import Decision
    from hopdata.steering.live.limits import Limits
    from hopdata.steering.live.robots import DrivenRobot
    from hopdata.steering.strides import StrideAxes, Strides

# Files of the folder, named as those of a study's model.
GEOMETRY = "geometry.json"
MODEL = "model.npz"
SCORES = "model_scores.csv"
STRIDES = "frame_changes.csv"
AXES = "axes.json"  # of a robot that is not the hopper

#: Share of the strides that a model is tested on.
#: Unit: 1. Origin: chosen.
TESTED_SHARE = 0.2
#: Longest time for a stride, and for what comes before the first one, by which an
#: excitation is over if nobody says otherwise.
#: Unit: s. Origin: chosen: three times that of a hop; a minute to arm it.
STRIDE_S = 2.0
BEFORE_S = 60.0

# Seed of the split into strides to learn from and to test on.
SEED = 1


def fewest_strides() -> int:
    """Return the fewest strides that a model can be learned from and tested on."""
    from hopdata.steering.control.forecast import NEIGHBOURS
    from hopdata.steering.models.training import LEAST_HOPS

    return LEAST_HOPS + NEIGHBOURS


# Before the drive.


def require_whole(options: argparse.Namespace) -> None:
    """Refuse options that do not go with an excitation, or without one."""
    if options.excite is None:
        for name in ("geometry", "excite_seed"):
            is_left_out = getattr(options, name) is None
            flag = f"--{name.replace('_', '-')}"
            require(is_left_out, flag, "--excite with it", "none")
        return
    for name in ("model", "rehearse", "adaptive", "heading"):
        found = getattr(options, name)
        is_left_out = found is None or found is False
        why = "the excitation alone, from which a model is learned"
        require(is_left_out, "--excite", why, f"--{name} with it")
    least = fewest_strides()
    wanted = f"at least {least} strides, to learn from and to test on"
    require(options.excite >= least, "--excite", wanted, options.excite)
    seed = seed_of(options)
    require(seed >= 0, "--excite-seed", "0 or more", seed)
    # That of another robot is told with it.
    has_geometry = options.host is None or options.geometry is not None
    has_geometry = has_geometry or options.robot is not None
    wanted = "geometry.json of the robot's markers (docs/live.md)"
    require(has_geometry, "--geometry", wanted, "none")


def folder_of(log: Path) -> Path:
    """Return the folder for the strides of a drive: the log's name, and new."""
    folder = log.with_name(f"{log.stem}-strides")
    how = "one that exists already; name another log"
    require(not folder.exists(), f"folder {folder}", "a new one", how)
    return folder


def longest_s(n_strides: int) -> float:
    """Return the time after which an excitation ends, s."""
    return BEFORE_S + STRIDE_S * n_strides


def seed_of(options: argparse.Namespace) -> int:
    """Return the seed of the sequence."""
    return 1 if options.excite_seed is None else int(options.excite_seed)


def drawn(options: argparse.Namespace, axes: StrideAxes) -> FloatArray:
    """Draw the sequence (n, U) within the limits of the robot's inputs."""
    from hopdata.steering.excitation import excitation

    return excitation(axes, options.excite, seed_of(options))


def geometry_files(path: Path | None, robot: DrivenRobot | None) -> dict[str, bytes]:
    """Return the geometry's file; without a path, that of the robot itself."""
    from hopdata.steering.live.rehearsal import simulated_geometry
    from hopdata.steering.observation.geometry import load_geometry

    if path is not None:
        load_geometry(path)
        return {GEOMETRY: path.read_bytes()}
    geometry = simulated_geometry() if robot is None else robot.geometry
    with tempfile.TemporaryDirectory() as folder:
        geometry.save(Path(folder, GEOMETRY))
        return {GEOMETRY: Path(folder, GEOMETRY).read_bytes()}


# After the drive.


def write_strides(
    folder: Path,
    decisions: Sequence[Decision],
    axes: StrideAxes,
    n_strides: int,
    limits: Limits,
    geometry: bytes,
) -> Strides:
    """Write the table of strides, the axes and the geometry to a new folder."""
    from hopdata.jobs import write_json, write_table
    from hopdata.steering.frame_changes import is_hopper
    from hopdata.steering.live.excited import excited_strides
    from hopdata.steering.strides import to_table

    name = folder.name.removesuffix("-strides")
    made = excited_strides(decisions, axes, n_strides, limits, recording=name)
    folder.mkdir(parents=True)
    if not is_hopper(axes):
        write_json(folder / AXES, axes.as_dict())
    (folder / GEOMETRY).write_bytes(geometry)
    write_table(folder / STRIDES, to_table(made))
    return made


def what_next(folder: Path, made: Strides, n_strides: int, seed: int) -> list[str]:
    """Say how many strides there are, which are missing, and what to do then."""
    n_used = len(made.used())
    missing = n_strides - n_used
    lines = [f"{n_used} of {counted(n_strides, 'stride')} in {folder / STRIDES}"]
    command = f"hopdata learn {folder}"
    if missing:
        left_out = ", ".join(f"{why}: {n}" for why, n in made.excluded().items())
        reasons = f" ({left_out})" if left_out else ""
        again = f"hopdata drive --excite {max(missing, fewest_strides())}"
        again = f"{again} --excite-seed {seed + 1}"
        lines.append(f"missing: {counted(missing, 'stride')}{reasons}")
        if made.fall():
            lines.append(made.fall())
        lines.append(f"more of them: {again} ...; hopdata learn takes both folders")
    if n_used < fewest_strides():
        lines.append(f"too few to learn from: {fewest_strides()} are needed")
        return lines
    lines.append(f"learn the model from them: {command}")
    return lines


# Learning.


def learn(options: argparse.Namespace) -> int:
    """Learn a model from folders of strides, and write it to the first of them."""
    import numpy as np

    from hopdata.jobs import write_table
    from hopdata.steering.control.forecast import NEIGHBOURS, forecast, warning
    from hopdata.steering.frame_changes import is_hopper
    from hopdata.steering.models.learning import (
        learned_and_rest,
        moves_of,
        prediction_score,
    )
    from hopdata.steering.models.process_file import save_process
    from hopdata.steering.models.training import trained_process
    from hopdata.steering.observation.geometry import load_geometry

    folder = options.folders[0]
    _require_one_geometry(options.folders)
    is_new = not (folder / MODEL).exists()
    require(is_new, f"{folder / MODEL}", "a new file", "one that exists already")
    changes = _strides_of(options.folders)
    n_used = len(changes.used())
    least = fewest_strides()
    if n_used < least:
        wanted = f"at least {least} strides that can be used"
        found = f"{n_used} (left out: {changes.excluded() or 'none'})"
        raise AnalysisError.at(folder / STRIDES, wanted, found)
    n_tested = max(NEIGHBOURS, round(TESTED_SHARE * n_used))
    block = {"training_hops": n_used - n_tested}
    seed = np.random.SeedSequence(SEED)
    with terminal.progress_line(f"learning from {counted(n_used, 'stride')}"):
        train, rest = learned_and_rest(changes, block, seed=seed)
        process = trained_process(train)
        scores = prediction_score(process, rest)
        if is_hopper(process.axes):
            expected = forecast(process, rest, state=[np.pi])
            scores = scores.assign(**expected.columns())
    moves = moves_of(train, load_geometry(folder / GEOMETRY))
    scores = scores.assign(moves=True, training_hops=len(train), test_hops=len(rest))
    scores.loc[: len(moves) - 1, "moves"] = moves
    # What does not move has no variance that could be explained.
    scores.loc[~scores["moves"], "r2"] = np.nan
    save_process(folder / MODEL, process)
    write_table(folder / SCORES, scores)
    learned = f"{len(train)} strides, tested on {len(rest)}"
    print(f"{folder / MODEL}: learned from {learned}")
    for row in scores.to_dict("records"):
        told = f"r2 {row['r2']:.2f}" if row["moves"] else "does not move"
        print(f"  {row['component']:8} {told}")
    said = warning(scores)
    if said is not None:
        print(f"warning: {said}")
    # The strides do not tell the name of their robot.
    named = "" if is_hopper(process.axes) else " --robot NAME"
    whose = ", with the NAME that excited the robot" if named else ""
    print(f"hopdata drive{named} --model {folder} drives with it{whose}")
    return terminal.OK


def _require_one_geometry(folders: Sequence[Path]) -> None:
    """Require folders of strides that were seen with the same geometry."""
    first = b""
    for folder in folders:
        path = folder / GEOMETRY
        for name in (GEOMETRY, STRIDES):
            wanted = f"{GEOMETRY} and {STRIDES}, as hopdata drive --excite writes them"
            if not (folder / name).is_file():
                raise ConfigError.at(folder, wanted, f"no {name}")
        found = path.read_bytes()
        first = first or found
        wanted = f"the geometry of {folders[0]}: other axes have other strides"
        require(found == first, f"{path}", wanted, "another")


def _strides_of(folders: Sequence[Path]) -> Strides:
    """Return the strides of all folders; the hopper's limit is its largest swing."""
    import numpy as np

    from hopdata.jobs import read_table
    from hopdata.steering import strides
    from hopdata.steering.frame_changes import FrameChanges, from_table, hopper_axes
    from hopdata.steering.strides import joined

    axes = _axes_of(folders)
    if axes is not None:
        tables = [read_table(folder / STRIDES) for folder in folders]
        return joined([strides.from_table(table, axes) for table in tables])
    parts = [from_table(read_table(folder / STRIDES)) for folder in folders]
    changes = joined(parts)
    swings = np.abs(changes.used().swing_rad)
    largest = float(swings.max(initial=0.0)) or np.pi
    return FrameChanges(**{**vars(changes), "axes": hopper_axes(largest)})


def _axes_of(folders: Sequence[Path]) -> StrideAxes | None:
    """Return the axes of a robot that is not the hopper; None for the hopper.

    Raises
    ------
    ConfigError
        If the folders are of several robots.
    RecordingError
        If a file of axes cannot be read.
    """
    from hopdata.errors import RecordingError
    from hopdata.foreign.texts import json_of
    from hopdata.steering.strides import StrideAxes

    found = None
    for folder in folders:
        axes = None
        if (folder / AXES).is_file():
            wanted = "the axes of a robot as JSON"
            content = json_of(folder / AXES, wanted=wanted, error=RecordingError)
            try:
                axes = StrideAxes.of_dict(content)
            except (KeyError, TypeError, ValueError) as error:
                raise RecordingError.at(folder / AXES, wanted, repr(error)) from None
        is_same = folder == folders[0] or axes == found
        wanted = f"strides of the robot of {folders[0]}"
        require(is_same, f"{folder}", wanted, "those of another")
        found = axes
    return found
