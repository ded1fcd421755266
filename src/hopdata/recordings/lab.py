"""What is in the folder of a laboratory: which files are trials of one study or group.

Left out, each with its reason, are files that cannot be read, that are too short, in
which the subject stands still, and those that hold a trial another file holds as well.
Of different sets of markers the one that most trials have is taken.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError
from hopdata.messages import Message
from hopdata.recordings.raw import RateUnknownError, RawRecording, without_subject
from hopdata.recordings.readers.formats import read_raw, suffixes
from hopdata.recordings.same_trial import (
    OTHER,
    PROCESSED,
    agreement,
    compared_markers,
)

#: Duration of a trial below which no landing fits in.
#: Unit: s. Origin: chosen.
SHORTEST_S = 0.5

#: Range within which a marker stays if it is still, relative to the size of all.
#: Unit: 1. Origin: chosen.
STILL = 0.03

#: Share of the markers that are still if the subject stands still. Arms may move.
#: Unit: 1. Origin: chosen.
STILL_MARKERS = 0.75

#: Quantiles between which the range of a marker is taken.
#: Unit: 1. Origin: chosen.
RANGE_QUANTILES = (0.05, 0.95)

#: Frames from which the range of a marker is taken.
#: Unit: frames. Origin: chosen.
RANGE_FRAMES = 500

#: Names that two sets of markers have in common, as a share of those of either, to
#: count as one. Unlabelled and hidden markers come and go.
#: Unit: 1. Origin: chosen.
ONE_SET = 0.8

#: Ratio of the lengths of two files of one trial up to which, about, the format says
#: which is kept; else it is the longer one.
#: Unit: 1. Origin: chosen.
AS_LONG = 1.15

# Names of markers that a reason lists.
MOST_NAMED = 8

# Why a file is left out that has the positions of another one.
SAME_POSITIONS = "recordings.lab_twice"

# Which of two files with the same trial is kept, if both are about as long: those that
# hold plates and events first, and text last.
_PREFERRED = (".c3d", ".h5", ".hdf5", ".mat", ".trc", ".tsv", ".csv", ".txt")

# Folders that hold results, and not recordings.
_NO_RECORDINGS = frozenset(("results", "config"))

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Trial:
    """One file that was read.

    Parameters
    ----------
    file, place : Path
        The file, and its path relative to the folder that was given.
    markers : tuple of str
        Its markers, without the name of a single subject.
    n_frames : int
        Number of frames.
    rate_hz : float
        Frame rate, Hz.
    unit : str
        Unit that the file or its format states.
    subject : str
        Subject that the file states; empty if it states none.
    is_still : bool
        Whether hardly any marker moves.
    compared : tuple of str
        Markers whose positions are kept.
    positions : (N, K, 3) float32 array
        Their positions, in the file's unit and axes.
    before_names : str
        Subject that the file puts before its markers' names, and that is left out.
    """

    file: Path
    place: Path
    markers: tuple[str, ...]
    n_frames: int
    rate_hz: float
    unit: str
    subject: str
    is_still: bool
    compared: tuple[str, ...]
    positions: FloatArray
    before_names: str = ""

    @property
    def duration_s(self) -> float:
        """Return the number of frames over the rate, s."""
        return self.n_frames / self.rate_hz


@dataclass(frozen=True)
class LeftOut:
    """A file that is no trial of the study, and why.

    Parameters
    ----------
    place : Path
        The file.
    reason : Message
        Why it is left out.
    """

    place: Path
    reason: Message

    def message(self) -> Message:
        """Return file and reason."""
        values = {"file": self.place.as_posix(), "reason": self.reason}
        return Message("recordings.left_out_file", values)


@dataclass(frozen=True)
class Lab:
    """What a folder holds.

    Parameters
    ----------
    trials : tuple of Trial
        Files to choose from, in the order of their paths.
    left_out : tuple of LeftOut
        Files that are no such trials.
    ignored : dict
        Number of files that no reader takes, by suffix.
    """

    trials: tuple[Trial, ...]
    left_out: tuple[LeftOut, ...]
    ignored: dict[str, int]


def survey(
    folder: Path,
    *,
    rate_hz: float | None = None,
    keeps_copies: bool = False,
    progress: Progress = lambda _step: None,
) -> Lab:
    """Read all files in a folder and its subfolders, and sort out those of no use.

    Parameters
    ----------
    folder : path
        A folder.
    rate_hz : float, optional
        Frame rate, for files that state none or a wrong one.
    keeps_copies : bool
        Whether files stay that seem to hold the trial of another one, filtered or
        resampled. Those with the same positions never do: a study refuses them.
    progress : callable
        Called with a description of each step before it begins.
    """
    readable, ignored = _files(folder)
    trials: list[Trial] = []
    left_out: list[LeftOut] = []
    for file in readable:
        place = file.relative_to(folder)
        progress(f"reading {place.as_posix()}")
        try:
            raw = read_raw(file, rate_hz=rate_hz)
            trial = _trial(file, place, raw)
        except RateUnknownError:
            reason = Message("recordings.lab_no_rate")
            left_out.append(LeftOut(place, reason))
            continue
        except RecordingError as error:
            left_out.append(LeftOut(place, unreadable(error, file)))
            continue
        unfit = _unfit(trial)
        if unfit is not None:
            left_out.append(LeftOut(place, unfit))
            continue
        trials.append(trial)
    progress("comparing the files")
    twice = _duplicates(trials, keeps_processed=keeps_copies)
    left_out += twice
    places_of_twice = {one.place for one in twice}
    kept = tuple(trial for trial in trials if trial.place not in places_of_twice)
    in_order = sorted(left_out, key=lambda one: one.place)
    return Lab(kept, tuple(in_order), ignored)


def _files(folder: Path) -> tuple[list[Path], dict[str, int]]:
    """Return the files that a reader takes, and count the others by suffix."""
    known = suffixes()
    readable = []
    ignored: Counter[str] = Counter()
    for file in sorted(folder.rglob("*")):
        inside = file.relative_to(folder).parts
        is_hidden = any(part.startswith(".") for part in inside)
        if is_hidden or inside[0] in _NO_RECORDINGS or not file.is_file():
            continue
        if file.suffix.lower() in known:
            readable.append(file)
        else:
            ignored[file.suffix.lower() or file.name] += 1
    return readable, dict(ignored)


def _trial(file: Path, place: Path, raw: RawRecording) -> Trial:
    """Keep of a file what is needed to compare it with others."""
    markers = without_subject(raw.markers)
    kept = compared_markers(markers)
    subject = _stated_subject(file)
    before_colon = {name.partition(":")[0] for name in raw.markers if ":" in name}
    if not subject and len(before_colon) == 1:
        (subject,) = before_colon
    left_out = ""
    if markers != tuple(raw.markers):
        (left_out,) = before_colon
    return Trial(
        file=file,
        place=place,
        markers=markers,
        n_frames=len(raw.time),
        rate_hz=raw.rate_hz,
        unit=raw.unit,
        subject=subject,
        is_still=_is_still(raw.positions),
        before_names=left_out,
        compared=tuple(markers[m] for m in kept),
        positions=raw.positions[:, kept].astype(np.float32),
    )


def _stated_subject(file: Path) -> str:
    """Return the single name in SUBJECTS:NAMES of a C3D file; empty without one."""
    if file.suffix.lower() != ".c3d":
        return ""
    from hopdata.recordings.readers.c3d import open_c3d

    try:
        _, parameters, _ = open_c3d(file)
        names = parameters.texts("SUBJECTS", "NAMES")
    except RecordingError:
        return ""
    given = [name.strip() for name in names if name.strip()]
    return given[0] if len(given) == 1 else ""


@np.errstate(over="ignore", invalid="ignore")  # absurd numbers are left to the checks
def _is_still(positions: FloatArray) -> bool:
    """Tell whether most markers (N, M, 3) stay where they are."""
    step = max(1, len(positions) // RANGE_FRAMES)
    frames = positions[::step]
    seen = np.isfinite(frames).all(axis=2).any(axis=0)
    frames = frames[:, seen]
    if not frames.size:
        return False
    low, high = np.nanquantile(frames, RANGE_QUANTILES, axis=0)
    ranges = np.linalg.norm(high - low, axis=1)
    size = np.linalg.norm(np.ptp((low + high) / 2, axis=0))
    return bool(np.quantile(ranges, STILL_MARKERS) < STILL * size)


def unreadable(error: RecordingError, file: Path) -> Message:
    """Return why a file cannot be read: the first line of an error, without the path.

    The path is told already beside the reason.
    """
    first = str(error).splitlines()[0].removeprefix(str(file)).lstrip(":, ")
    return Message("recordings.lab_unreadable", {"error": first})


def _unfit(trial: Trial) -> Message | None:
    """Return why a file can hold no landing; None if it may."""
    if trial.duration_s < SHORTEST_S:
        values = {"frames": trial.n_frames, "duration_s": trial.duration_s}
        return Message("recordings.lab_too_short", values)
    if trial.is_still:
        return Message("recordings.lab_still")
    return None


def _duplicates(trials: Sequence[Trial], *, keeps_processed: bool) -> list[LeftOut]:
    """Return the trials that another file holds as well, and holds better.

    With `keeps_processed`, only those with the same positions.
    """
    in_order = sorted(trials, key=_rank)
    kept: list[Trial] = []
    left_out = []
    for trial in in_order:
        twins = _twins(trial, kept)
        if keeps_processed:
            twins = (twin for twin in twins if twin.code == SAME_POSITIONS)
        twin = next(twins, None)
        if twin is None:
            kept.append(trial)
        else:
            left_out.append(LeftOut(trial.place, twin))
    return left_out


def _rank(trial: Trial) -> tuple[int, int, int, int, str]:
    """Return the order in which trials are kept: the whole before its pieces."""
    length = round(float(np.log(trial.n_frames) / np.log(AS_LONG)))
    suffix = trial.file.suffix.lower()
    place = len(_PREFERRED)
    if suffix in _PREFERRED:
        place = _PREFERRED.index(suffix)
    at = trial.place.as_posix()
    return -length, place, -len(trial.markers), -trial.n_frames, at


def _twins(trial: Trial, kept: Sequence[Trial]) -> Iterator[Message]:
    """Yield why a trial is none of its own, for each that holds it as well."""
    for other in kept:
        agree = agreement(
            (trial.compared, other.compared),
            (trial.positions, other.positions),
            (trial.rate_hz, other.rate_hz),
        )
        if agree == OTHER:
            continue
        code = SAME_POSITIONS
        if agree == PROCESSED:
            code = "recordings.lab_processed"
        yield Message(code, {"other": other.place.as_posix()})


def main_marker_set(trials: Sequence[Trial]) -> tuple[list[Trial], tuple[str, ...]]:
    """Return the trials with the most usual markers, and the names all of these have.

    Parameters
    ----------
    trials : sequence of Trial
        At least one.
    """
    best: list[Trial] = []
    for names in dict.fromkeys(frozenset(trial.markers) for trial in trials):
        alike = [trial for trial in trials if _are_one_set(names, trial.markers)]
        if _weight(alike) > _weight(best):
            best = alike
    shared = set.intersection(*(set(trial.markers) for trial in best))
    common = tuple(name for name in best[0].markers if name in shared)
    return best, common


def _are_one_set(names: frozenset[str], others: Sequence[str]) -> bool:
    either = names | set(others)
    return len(names & set(others)) >= ONE_SET * len(either)


def _weight(trials: Sequence[Trial]) -> tuple[int, int]:
    """Return the number of trials and of their frames."""
    return len(trials), sum(trial.n_frames for trial in trials)


def lacking(trial: Trial, needed: Sequence[str]) -> Message | None:
    """Return which of the study's markers a trial lacks; None if it has them all."""
    lacks = [name for name in needed if name not in trial.markers]
    if not lacks:
        return None
    values = {"lacks": ", ".join(lacks), "has": ", ".join(trial.markers[:MOST_NAMED])}
    if len(trial.markers) > MOST_NAMED:
        values["has"] += f" and {len(trial.markers) - MOST_NAMED} more"
    return Message("recordings.lab_other_markers", values)
