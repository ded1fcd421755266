"""`python -m hopdata` is the command `hopdata`."""

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path

from hopdata import __version__
from hopdata.commands.terminal import INTERRUPTED, OK, PROBLEM
from hopdata.errors import HopdataError, did_you_mean

# The command ``hopdata``: its command line, and one message instead of a traceback.
#
# The commands themselves are in `hopdata.commands`, each imported when it runs, so that
# ``hopdata --help`` is there at once.

EXIT_CODES = """\
exit codes:
  0    all is well
  1    a problem in the configuration or the data, told on stderr or in the listing
  2    a wrong command line
  130  interrupted
"""
OVERVIEW = f"""\
from a file to a report:
  hopdata inspect monday.tsv                what is in it, and what looks wrong
  hopdata view monday.tsv                   turn it in 3-D
  hopdata init monday.tsv                   write config/monday.yaml, roles guessed
  hopdata check config/monday.yaml          does it all fit?
  hopdata run config/monday.yaml            results/monday/report.html

{EXIT_CODES}"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    arguments : sequence of str, optional
        Command line without the program's name; by default that of the process.

    Returns
    -------
    int
        Exit code: 0, or 1 after a user's mistake, told on stderr, and where the data have a
        problem; 130 when interrupted. A wrong command line ends in argparse's SystemExit with
        code 2.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    # What follows "--" is Snakemake's; to argparse it would be more arguments of our own.
    own = given.index("--") if given[:1] == ["run"] and "--" in given else len(given)
    options = _parser().parse_args(given[:own], argparse.Namespace(passed_on=given[own + 1 :]))
    try:
        module, _, name = options.run.partition(":")
        code: int = getattr(import_module(module), name)(options)
        sys.stdout.flush()
        return code
    except HopdataError as error:
        print(f"hopdata: error: {error}", file=sys.stderr)
        return PROBLEM
    except BrokenPipeError:  # the reader of our output, such as head, has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except KeyboardInterrupt:
        print("hopdata: interrupted", file=sys.stderr)
        return INTERRUPTED


class _Parser(argparse.ArgumentParser):
    """A parser that names the nearest command for one that is misspelt."""

    def _check_value(self, action: argparse.Action, value: object) -> None:
        choices = [str(choice) for choice in action.choices or ()]
        if choices and value not in (action.choices or ()):
            raise argparse.ArgumentError(
                action,
                f"expected one of {', '.join(choices)}, found '{value}'"
                f"{did_you_mean(str(value), choices)}",
            )


def _parser() -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = _Parser(
        prog="hopdata",
        description="Is landing on several feet one smooth map? From motion capture to figures.",
        epilog=OVERVIEW,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"hopdata {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, (place, summary, description, examples, add_options) in COMMANDS.items():
        command = commands.add_parser(
            name,
            help=summary,
            description=description,
            epilog=f"examples:\n{examples}\n{EXIT_CODES}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.set_defaults(run=place)
        add_options(command)
    return parser


def _inspect_options(command: argparse.ArgumentParser) -> None:
    _add_file(command)
    command.add_argument("--html", type=Path, metavar="PAGE", help="also write a page with figures")


def _view_options(command: argparse.ArgumentParser) -> None:
    _add_file(command)
    what = "page to write; else FILE.html in the folder for temporary files"
    command.add_argument("-o", "--out", type=Path, metavar="PAGE", help=what)
    command.add_argument("--no-browser", action="store_true", help="only write it")


def _init_options(command: argparse.ArgumentParser) -> None:
    _add_file(command)
    command.add_argument("-o", "--out", type=Path, metavar="CONFIG", help="else config/FILE.yaml")
    command.add_argument("--force", action="store_true", help="replace CONFIG if it is there")


def _check_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("config", metavar="CONFIG", help="such as config/config.yaml")


def _run_options(command: argparse.ArgumentParser) -> None:
    command.usage = (
        "%(prog)s [-h] [--cores N] [--dry-run] [--force] [CONFIG | --from FILE] "
        "[-- SNAKEMAKE OPTIONS]"
    )
    what = "such as config/monday.yaml; else that of the bundled sample"
    command.add_argument("config", nargs="?", type=Path, metavar="CONFIG", help=what)
    command.add_argument("--cores", type=_cores, default="2", metavar="N", help="or all; 2")
    what = "make the study of this provenance.json again, and compare"
    command.add_argument("--from", dest="provenance", type=Path, metavar="FILE", help=what)
    command.add_argument("--dry-run", action="store_true", help="only say what would be done")
    command.add_argument("--force", action="store_true", help="do all anew, up to date or not")


def _clean_options(command: argparse.ArgumentParser) -> None:
    what = "the configuration of a study or group"
    command.add_argument("config", nargs="?", type=Path, metavar="CONFIG", help=what)
    command.add_argument("--all", action="store_true", help="every study in this folder")
    command.add_argument("--dry-run", action="store_true", help="only say what would be removed")


def _plan_options(command: argparse.ArgumentParser) -> None:
    what = "verdict.json of a pilot, or a configuration, which is first run as far as that"
    command.add_argument("pilot", type=Path, metavar="PILOT", help=what)
    what = "a size besides those of the table"
    command.add_argument("--difference", type=_positive, metavar="SHARE", help=what)
    what = "draw the curve into this file (svg, png or pdf)"
    command.add_argument("--figure", type=Path, metavar="FILE", help=what)


def _drive_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add("--simulate", action="store_true", help="the simulated hopper, as without --host")
    add("--host", help="the computer that runs Qualisys Track Manager")
    add("--port", type=int, default=22223, help="of its real-time server; %(default)s")
    add("--boom", metavar="HOST:PORT", help="where each swing is sent, as a line over UDP")
    add("--dry-run", action="store_true", help="send nothing to the boom")
    what = "folder with geometry.json and model.npz, as results/STUDY/steering/seeds/1"
    add("--model", type=Path, metavar="FOLDER", help=what)
    what = "come to this point of the floor, m, as in --to=-0.5,0; else to 0,0"
    add("--to", type=_point, default=(0.0, 0.0), metavar="X,Y", help=what)
    add("--heading", type=float, metavar="DEG", help="turn to this heading instead")
    add("--adaptive", action="store_true", help="correct the model hop by hop")
    add("--seconds", type=_positive, metavar="S", default=60.0, help="at most; %(default)g")
    add("--rate", type=_positive, metavar="HZ", default=100.0, help="of the cameras; %(default)g")
    what = "largest swing that is sent, no more than was recorded; %(default).3g"
    add("--swing-limit", type=_positive, metavar="RAD", default=1.1780972450961724, help=what)
    what = "farthest from the origin before the boom rests for good; %(default)g"
    add("--fence", type=_positive, metavar="M", default=3.0, help=what)
    add("--log", type=Path, metavar="FILE", default=Path("drive.h5"), help="written as it goes")


def _replay_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("log", type=Path, metavar="LOG", help="as `hopdata drive` wrote it")


def _config_docs_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("--out", type=Path, metavar="FILE", help="file to write; else stdout")


def _add_file(command: argparse.ArgumentParser) -> None:
    """Add the file, and what the user may know better than the guess."""
    add = command.add_argument
    add("file", type=Path, metavar="FILE", help="a recording, such as monday.tsv")
    add("--unit", choices=("mm", "m"), help="unit of the file; else guessed")
    what = "direction of the file that is up, as in --vertical-axis=-z; else guessed"
    add("--vertical-axis", choices=("x", "y", "z", "-x", "-y", "-z"), help=what)
    what = "frame rate, if the file does not state it, or not the true one"
    add("--rate", type=_positive, metavar="HZ", help=what)
    what = "memory a packed file may ask for, as input.most_unpacked_mb; %(default)g"
    add("--most-unpacked-mb", type=_positive, metavar="MB", default=2000.0, help=what)


# Command: where it stands, a line on it, what it does, examples, and what adds its options.
COMMANDS: dict[str, tuple[str, str, str, str, Callable[[argparse.ArgumentParser], None]]] = {
    "inspect": (
        "hopdata.commands.inspect:inspect",
        "say what is in a recording, and what looks wrong",
        "Say what is in a recording: markers, rate, gaps, unit and vertical axis, rigid clusters,\n"
        "noise; and what looks wrong: swaps, spikes, jumps, frozen markers, dropped frames,\n"
        "irregular time stamps. Exit code 1 if anything does; gaps alone do not count.",
        "  hopdata inspect data/sample/hopper.h5\n"
        "  hopdata inspect monday.tsv --html monday.html\n"
        "  hopdata inspect monday.tsv --rate 250        a file that does not state its rate\n",
        _inspect_options,
    ),
    "view": (
        "hopdata.commands.inspect:view",
        "turn a recording in 3-D, in a browser",
        "Write a page that shows the markers of a recording in 3-D, to be turned by hand and\n"
        "scrubbed in time, and open it. It needs no network.",
        "  hopdata view data/sample/hopper.h5\n"
        "  hopdata view monday.tsv --vertical-axis=y -o monday.html --no-browser\n",
        _view_options,
    ),
    "init": (
        "hopdata.commands.init:init",
        "write a first configuration for a recording",
        "Write a configuration, the roles of the markers guessed from motion and names, each with\n"
        "its reason. Exit code 1 if something must be filled in by hand.",
        "  hopdata init data/sample/hopper.h5           writes config/hopper.yaml\n"
        "  hopdata init monday.tsv -o config/mine.yaml\n",
        _init_options,
    ),
    "check": (
        "hopdata.commands.check:check",
        "check a configuration and its recordings",
        "Read a configuration and its recordings, and say what a study will find: landings used,\n"
        "whether the verdict is in reach, what to change. Exit code 1 if anything is wrong.",
        "  hopdata check config/config.yaml\n",
        _check_options,
    ),
    "run": (
        "hopdata.commands.run:run",
        "run a study, from its recordings to its report",
        "Run the workflow of this installation on a study, a group of them (a configuration with\n"
        "samples), or the bundled sample. Results go to results/ in the current folder, what\n"
        "Snakemake says to results/STUDY/logs/run.log. In a clone, `snakemake` does the same.",
        "  hopdata run                                  the bundled sample\n"
        "  hopdata run config/monday.yaml --cores 4\n"
        "  hopdata run config/group.yaml --dry-run\n"
        "  hopdata run config/monday.yaml -- --keep-going   Snakemake's own options\n",
        _run_options,
    ),
    "plan": (
        "hopdata.commands.run:plan",
        "say how many landings show which difference",
        "Say how many landings a study takes to show a difference, from the verdict on a pilot: a\n"
        "short recording of the same kind, or a study simulated as its configuration says.\n"
        "Errors fall with the root of the number of landings.",
        "  hopdata plan results/sample/verdict.json\n"
        "  hopdata plan config/quadruped.yaml --difference 0.08 --figure plan.svg\n",
        _plan_options,
    ),
    "drive": (
        "hopdata.commands.drive:drive",
        "steer a hopper live, simulated or seen by cameras",
        "Steer a hopper from stance to stance: the simulated one, or a robot that a Qualisys\n"
        "system sees. Never tried on hardware: docs/live.md says what to do the first time.\n"
        "The boom rests when anything is wrong, at Enter, Ctrl-C and SIGTERM.",
        "  hopdata drive                                simulated\n"
        "  hopdata drive --host 10.0.0.2 --model results/monday/steering/seeds/1 --dry-run\n",
        _drive_options,
    ),
    "replay": (
        "hopdata.commands.drive:replay",
        "play the log of a drive into the same controller",
        "Play the frames of a log into the same observer and controller, and compare the plans.\n"
        "Exit code 1 if one is not the same to the bit. Nothing is sent.",
        "  hopdata replay drive.h5\n",
        _replay_options,
    ),
    "clean": (
        "hopdata.commands.run:clean",
        "remove the results of a study",
        "Remove results/STUDY of a configuration, or with --all results and .snakemake of this\n"
        "folder. Refused while a run holds the folder.",
        "  hopdata clean config/monday.yaml\n  hopdata clean --all --dry-run\n",
        _clean_options,
    ),
    "doctor": (
        "hopdata.commands.run:doctor",
        "say what this installation has, and what it lacks",
        "Versions, cores, memory, workflow, compiled code, space. Exit code 1 if anything lacks.",
        "  hopdata doctor\n",
        lambda _: None,
    ),
    "completion": (
        "hopdata.__main__:completion",
        "print what makes a shell complete the commands",
        "Print a line for bash, or for zsh after bashcompinit.",
        '  eval "$(hopdata completion)"      in ~/.bashrc\n',
        lambda _: None,
    ),
    "config-docs": (
        "hopdata.commands.init:config_docs",
        "describe the configuration's keys",
        "Write the page on all keys of the configuration, as Markdown.",
        "  hopdata config-docs --out docs/configuration.md\n",
        _config_docs_options,
    ),
}


def completion(_options: argparse.Namespace) -> int:
    """Print what makes a shell (bash; zsh after bashcompinit) complete the commands and files."""
    print(f'complete -o default -W "{" ".join(COMMANDS)}" {Path(sys.argv[0]).name or "hopdata"}')
    return OK


def _point(text: str) -> tuple[float, ...]:
    with suppress(ValueError):
        x, y = map(float, text.split(","))
        return x, y
    raise argparse.ArgumentTypeError(f"expected X,Y, found '{text}'")


def _positive(text: str) -> float:
    with suppress(ValueError):
        if 0 < (value := float(text)) < float("inf"):
            return value
    raise argparse.ArgumentTypeError(f"expected a number above 0, found '{text}'")


def _cores(text: str) -> str:
    if text != "all" and not (text.isdecimal() and int(text)):  # with 0 Snakemake waits for ever
        raise argparse.ArgumentTypeError(f"expected a whole number above 0, or all, found '{text}'")
    return text


if __name__ == "__main__":
    sys.exit(main())
