"""The command ``hopdata``.

Each command is a function from its arguments to an exit code. It imports what it needs when it
runs, so that ``hopdata --help`` is there at once.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata import __version__
from hopdata.errors import HopdataError, RecordingError

if TYPE_CHECKING:
    from hopdata.recordings.recording import Recording

EXIT_OK, EXIT_MISTAKE, EXIT_INTERRUPTED = 0, 1, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    arguments : sequence of str, optional
        Command line without the program's name; by default that of the process.

    Returns
    -------
    int
        Exit code: 0, or 1 after a user's mistake, told on stderr; 130 when interrupted. A wrong
        command line ends in argparse's SystemExit with code 2.
    """
    options = _parser().parse_args(arguments)
    try:
        code: int = options.run(options)
        sys.stdout.flush()
        return code
    except HopdataError as error:
        print(f"hopdata: error: {error}", file=sys.stderr)
        return EXIT_MISTAKE
    except BrokenPipeError:  # the reader of our output, such as head, has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_OK
    except KeyboardInterrupt:
        print("hopdata: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED


def check(options: argparse.Namespace) -> int:
    """Check a configuration and read all its recordings."""
    from hopdata.config.loading import load_config
    from hopdata.config.recordings import files_of
    from hopdata.recordings.importing import import_recording
    from hopdata.recordings.plausibility import check_plausible, notes

    config = load_config(options.config)
    print(f"study {config['study']}")
    mistakes: list[str] = []
    remarks: list[str] = []
    for entry in config["recordings"]:
        if entry["file"] is None:
            print(f"{entry['name']}: simulated, {config['simulation']['hops']} hops")
            continue
        try:
            recording, _ = import_recording(
                files_of(entry), name=entry["name"], markers=config["markers"], **config["input"]
            )
            check_plausible(recording)
        except RecordingError as error:
            mistakes.append(str(error))
            continue
        print(_summary(recording, config))
        remarks += notes(recording)
    for remark in remarks:
        print(f"note: {remark}")
    if mistakes:
        raise RecordingError("\n".join(mistakes))
    print(f"{options.config} is sound")
    return EXIT_OK


def config_docs(options: argparse.Namespace) -> int:
    """Write the page on the configuration's keys."""
    from hopdata.config.documentation import configuration_page

    page = configuration_page()
    if options.out is None:
        print(page, end="")
        return EXIT_OK
    try:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(page, encoding="utf-8")
    except OSError as error:
        raise HopdataError(
            f"{options.out}: expected a file that can be written, found: {error.strerror}"
        ) from None
    return EXIT_OK


def _summary(recording: Recording, config: dict[str, Any]) -> str:
    """Say in a few lines what a recording holds."""
    from hopdata.recordings.plausibility import body_over_feet, fraction_seen

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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="hopdata",
        description="Is landing on several feet one smooth map? From motion capture to figures.",
        epilog="The analysis itself runs with: snakemake --cores 2 --configfile CONFIG",
    )
    parser.add_argument("--version", action="version", version=f"hopdata {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    command = commands.add_parser(
        "check",
        help="check a configuration and its recordings",
        description="Check a configuration, read its recordings, and say what is in them. "
        "Exit code 1, and a line on each mistake, if anything is wrong. Nothing is written.",
    )
    command.add_argument("config", metavar="CONFIG", help="such as config/config.yaml")
    command.set_defaults(run=check)

    command = commands.add_parser(
        "config-docs",
        help="describe the configuration's keys",
        description="Write the page on all keys of the configuration, as Markdown.",
    )
    command.add_argument("--out", type=Path, metavar="FILE", help="file to write; else stdout")
    command.set_defaults(run=config_docs)
    return parser
