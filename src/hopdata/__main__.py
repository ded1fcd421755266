"""`python -m hopdata` is the command `hopdata`."""

import argparse
import os
import sys
import tomllib
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

#: Of each command where it stands, a line on it, what it does, and examples.
COMMANDS: dict[str, dict[str, str]] = tomllib.loads(
    Path(__file__).with_name("commands").joinpath("commands.toml").read_text(encoding="utf-8")
)
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
    for name, told in COMMANDS.items():
        command = commands.add_parser(
            name,
            help=told["summary"],
            description=told["description"],
            epilog=f"examples:\n{told['examples']}\n{EXIT_CODES}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.set_defaults(run=told["run"])
        if name in OPTIONS:
            OPTIONS[name](command)
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


OPTIONS: dict[str, Callable[[argparse.ArgumentParser], None]] = {
    "inspect": _inspect_options,
    "view": _view_options,
    "init": _init_options,
    "check": _check_options,
    "run": _run_options,
    "plan": _plan_options,
    "drive": _drive_options,
    "replay": _replay_options,
    "clean": _clean_options,
    "config-docs": _config_docs_options,
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
