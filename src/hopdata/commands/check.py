"""``hopdata check``: check a configuration and all its recordings."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import GRAVITY_M_S2
from hopdata.commands import terminal
from hopdata.errors import AnalysisError, RecordingError
from hopdata.recordings.external import (
    ForceSignal,
    read_contact_times,
    read_force_signals,
)

if TYPE_CHECKING:
    from hopdata.recording import Recording


def check(options: argparse.Namespace) -> int:
    """Check a configuration, read all its recordings and forecast its first study."""
    from hopdata.commands.run import bring_bundled
    from hopdata.config.consistency import feet_of, files_of, simulation_of
    from hopdata.config.loading import load_config, place_of, read_yaml
    from hopdata.samples import read_group
    from hopdata.landings.floor import moving
    from hopdata.recording import extent, require_distinct
    from hopdata.recordings.importing import import_recording
    from hopdata.recordings.plausibility import check_plausible, notes

    bring_bundled(Path(options.config))
    content, studies = read_yaml(options.config), [options.config]
    if isinstance(content, Mapping) and "samples" in content:
        studies = [
            one["config"] for one in read_group(options.config)["members"].values()
        ]
    first, *others = (load_config(one, files=[options.config]) for one in studies)
    print(
        f"study {first['study']}"
        + f", the first of {len(studies)} of a group" * bool(others)
    )
    mistakes: list[str] = []
    remarks: list[str] = []
    sound: list[Recording] = []
    for config, entry in (
        (one, entry) for one in (first, *others) for entry in one["recordings"]
    ):
        if not (files := files_of(entry)):
            hops, cut_s = map(
                simulation_of(config, entry["name"]).get, ("hops", "duration_s")
            )
            cut = "" if cut_s is None else f", cut at {cut_s:g} s"
            print(f"{entry['name']}: simulated, {hops} hops{cut}: see hopdata plan")
            continue
        asked = {key: entry[key] for key in ("name", "exclude")} | config["input"]
        try:
            with terminal.progress_line(f"reading {', '.join(files)}") as progress:
                recording, _ = import_recording(
                    files, markers=config["markers"], **asked
                )
                progress(f"checking {', '.join(files)}")
                check_plausible(recording, **config["quality"])
            span_s, rate_hz = (
                recording.time[[0, -1]].tolist(),
                config["input"]["rate_hz"],
            )
            of: dict[str, Any] = {
                "feet": feet_of(config),
                "extent_m": extent(recording.positions),
            }
            known = describe_external(entry, span_s=span_s, rate_hz=rate_hz, **of)
        except RecordingError as error:
            key = re.search(r"markers\.\w+: expected .*", str(error))
            place = place_of(key[0], [options.config], "") if key else ""
            mistakes.append(f"{place}: {error}" if place else str(error))
            continue
        brief = f"study {config['study']}: {recording.told()}"
        print(
            "\n".join([_summary(recording, config), *known])
            if config is first
            else brief
        )
        sound += [recording] * (config is first)
        remarks += [*map(str, notes(recording)), *_suspects(recording, rate_hz)]
        remarks += [
            f"{recording.place}: {moves}" for moves in [moving(recording)] if moves
        ]
    for remark in remarks:
        print(f"note: {remark}")
    if mistakes:
        raise RecordingError(*mistakes)
    require_distinct(sound)
    but = _foretell(first, sound) if len(sound) == len(first["recordings"]) else ""
    but = but or "see the notes above" * bool(remarks)
    print(f"{options.config} " + (f"can be run, but {but}" if but else "is sound"))
    return terminal.OK


def _foretell(config: dict[str, Any], recordings: list[Recording]) -> str:
    """Print a forecast of the study; return why it is hardly worth running, if so.

    Raises
    ------
    AnalysisError
        If the study will stop.
    """
    from hopdata.commands.forecast import foretell, told

    with terminal.progress_line("looking for landings"):
        forecast = foretell(config, recordings)
    print("\n".join(told(forecast, config, recordings)))
    if forecast.stops:
        raise AnalysisError(forecast.reason)
    return forecast.vain


def _suspects(recording: Recording, rate_hz: float | None) -> list[str]:
    """Return a line on suspect data of the study's markers, and ask for a missing rate."""
    from hopdata.recordings.quality.inspection import inspect

    with terminal.progress_line(f"looking for faults in {recording.place}"):
        found = inspect(recording)
    told = f"{recording.place}: {terminal.answer(found)} See 'hopdata inspect'"
    asked = [] if rate_hz else terminal.question("input.rate_hz", found.rate)
    faulty = bool(found.faults.count or len(found.timing.irregular) or found.lost)
    return [f"{recording.place}: {one}" for one in asked + found.lost] + [told] * faulty


def _summary(recording: Recording, config: dict[str, Any]) -> str:
    """Summarise the contents of a recording in a few lines."""
    from hopdata.recording import body_over_feet, fraction_seen

    duration = recording.time[-1] - recording.time[0]
    seen = fraction_seen(recording)
    worst = int(seen.argmin())
    return "\n".join([
        f"{recording.name}: {recording.place}",
        f"  frames  {len(recording.time)} at {recording.rate_hz:g} Hz, {duration:.1f} s",
        *(f"  {key:6}  {', '.join(names)}" for key, names in config["markers"].items() if names),
        f"  height  body {body_over_feet(recording)[2]:.3f} m above the feet (median)",
        f"  seen    {_percent(seen.mean())} of all markers and frames; "
        f"least {recording.markers[worst]}, {_percent(seen[worst])}",
    ])  # fmt: skip


def _percent(share: float) -> str:
    """Write a share in per cent, rounded down so that 100 means all."""
    return f"{np.floor(1e4 * share) / 100:g} %"


# Contents of a recording's external files, in a few lines.

# Mass over the cube of the markers' span, kg/m³: about 40 for a runner, 20 for the
# hopper, 5000 for a runner of whom only a shoe is seen. A wrong unit changes it by a
# factor of 1000.
PLAUSIBLE_MASS = (1.0, 5000.0)
PLAUSIBLE_SHARE = (
    0.02,
    3.0,
)  # mean force over body weight, including a plate under one foot
LEAST_OVERLAP = (
    0.75  # of the recording and of the signal; below it, their clocks are doubtful
)


def describe_external(
    recording: Mapping[str, Any],
    *,
    feet: Sequence[str],
    span_s: tuple[float, float],
    rate_hz: float | None = None,
    extent_m: float | None = None,
) -> list[str]:
    """Read the contacts and forces named by a recording, and describe them.

    Parameters
    ----------
    recording : mapping
        Entry of ``recordings`` in the configuration.
    feet : sequence of str
        ``markers.feet``.
    span_s : tuple of float
        First and last time of the recording's frames, s.
    rate_hz : float, optional
        ``input.rate_hz``.
    extent_m : float, optional
        Span of the markers, m, from which a plausible body weight follows.

    Returns
    -------
    list of str
        One line per column; none without external files.

    Raises
    ------
    RecordingError
        If a file cannot be read.
    """
    lines = []
    if recording["contacts"]["file"] is not None:
        for known in read_contact_times(
            recording["contacts"], feet=feet, rate_hz=rate_hz
        ):
            first, last = known.span_s
            told = f"{known.column.name}: {len(known.instant)}, {first:.3f} to {last:.3f} s"
            lines.append(f"  contacts  {told}, of {', '.join(known.column.feet)}")
    if recording["forces"]["file"] is not None:
        for signal in read_force_signals(recording["forces"], feet=feet):
            first, last = signal.time[[0, -1]].tolist()
            told = f"{signal.column.name}: {len(signal.time)} samples, {first:.3f} to {last:.3f} s"
            told += f", up to {np.nanmax(signal.force):.4g} {signal.unit}"
            odd = _misplaced((first, last), span_s) + _misjudged(signal, extent_m)
            lines.append(f"  force     {told}, of {', '.join(signal.column.feet)}{odd}")
    return lines


def _misplaced(span_s: tuple[float, float], recording_s: tuple[float, float]) -> str:
    """Report a signal that misses much of the recording or lies far outside it: a wrong clock."""
    overlap = max(0.0, min(span_s[1], recording_s[1]) - max(span_s[0], recording_s[0]))
    covered = overlap / max(recording_s[1] - recording_s[0], 1e-9)
    inside = overlap / max(span_s[1] - span_s[0], 1e-9)
    if min(covered, inside) >= LEAST_OVERLAP:
        return ""
    beyond = f"{100 * (1 - inside):.0f} % of it lies outside"
    told = f"covers {100 * covered:.0f} % of the recording, {beyond}"
    return f" ({told}: are rate_hz and offset_s right?)"


def _misjudged(signal: ForceSignal, extent_m: float | None) -> str:
    """Report a mean force that cannot be a body weight: a wrong unit."""
    mean, weight = float(np.nanmean(signal.force)), signal.options["body_weight_n"]
    if signal.unit == "body_weight" or weight is not None:
        share = mean if signal.unit == "body_weight" else mean / weight
        if PLAUSIBLE_SHARE[0] <= share <= PLAUSIBLE_SHARE[1]:
            return ""
        return f" (on average {share:.3g} times the body weight: is forces.unit right?)"
    if extent_m is None or not extent_m > 0:
        return ""
    low, high = (GRAVITY_M_S2 * mass * extent_m**3 for mass in PLAUSIBLE_MASS)
    if low <= mean <= high:
        return ""
    weighs = f"where a body of {extent_m:.2g} m weighs {low:.2g} to {high:.2g} N"
    return f" ({mean:.3g} N on average, {weighs}: is forces.unit right?)"
