"""``hopdata check``: a configuration and all its recordings."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from hopdata.commands.exit_codes import OK
from hopdata.commands.progress import Progress
from hopdata.errors import RecordingError

if TYPE_CHECKING:
    from hopdata.recordings.recording import Recording


def check(options: argparse.Namespace) -> int:
    """Check a configuration and read all its recordings."""
    from hopdata.config.loading import load_config
    from hopdata.config.recordings import files_of, simulation_of
    from hopdata.recordings.distinct import require_distinct
    from hopdata.recordings.external_files import describe_external
    from hopdata.recordings.importing import import_recording
    from hopdata.recordings.plausibility import check_plausible
    from hopdata.recordings.remarks import notes
    from hopdata.recordings.span import extent

    config = load_config(options.config)
    print(f"study {config['study']}")
    mistakes: list[str] = []
    remarks: list[str] = []
    sound: list[Recording] = []
    for entry in config["recordings"]:
        files = files_of(entry)
        if not files:
            print(f"{entry['name']}: simulated, {_length(simulation_of(config, entry['name']))}")
            continue
        try:
            with Progress() as progress:
                progress(f"reading {', '.join(files)}")
                recording, _ = import_recording(
                    files, name=entry["name"], markers=config["markers"], **config["input"]
                )
                progress(f"checking {', '.join(files)}")
                check_plausible(recording, **config["quality"])
            known = describe_external(
                entry,
                feet=config["markers"]["feet"],
                span_s=(float(recording.time[0]), float(recording.time[-1])),
                rate_hz=config["input"]["rate_hz"],
                extent_m=extent(recording.positions),
            )
        except RecordingError as error:
            mistakes.append(str(error))
            continue
        print("\n".join([_summary(recording, config), *known]))
        remarks += [*notes(recording), *_suspects(recording)]
        sound.append(recording)
    for remark in remarks:
        print(f"note: {remark}")
    try:
        require_distinct(sound)
    except RecordingError as error:
        mistakes.append(str(error))
    if mistakes:
        raise RecordingError(*mistakes)
    print(f"{options.config} is sound")
    return OK


def _suspects(recording: Recording) -> list[str]:
    """Say in a line what looks wrong with the study's markers, if anything does."""
    from hopdata.commands.listing import answer
    from hopdata.recordings.quality.tables import inspect

    with Progress() as progress:
        progress(f"looking for faults in {recording.source}")
        found = inspect(recording)
    if not found.faults.count:
        return []
    return [f"{recording.source}: {answer(found)} 'hopdata inspect' lists them"]


def _length(simulation: dict[str, Any]) -> str:
    """Say how long a simulated recording is."""
    hops, duration = simulation["hops"], simulation["duration_s"]
    return f"{hops} hops" if duration is None else f"{hops} hops, cut at {duration:g} s"


def _summary(recording: Recording, config: dict[str, Any]) -> str:
    """Say in a few lines what a recording holds."""
    from hopdata.recordings.span import body_over_feet, fraction_seen

    duration = recording.time[-1] - recording.time[0]
    seen = 100 * fraction_seen(recording)
    worst = int(seen.argmin())
    lines = [
        f"{recording.name}: {recording.source}",
        f"  frames  {len(recording.time)} at {recording.rate_hz:g} Hz, {duration:.1f} s",
        *(f"  {key:6}  {', '.join(names)}" for key, names in config["markers"].items() if names),
        f"  height  body {body_over_feet(recording)[2]:.3f} m above the feet (median)",
        f"  seen    {seen.mean():.1f} % of all markers and frames; "
        f"least {recording.markers[worst]}, {seen[worst]:.1f} %",
    ]
    return "\n".join(lines)
