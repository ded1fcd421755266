"""The command `hopdata`, also run by `python -m hopdata`."""

# `python -m` puts the working folder first on Python's path. That is the folder of a
# study, and nothing in it is imported. `sys` is part of the interpreter, and no file
# can stand in for it.
import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    del sys.path[0]

import argparse
import os
import tomllib
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from hopdata import __version__, products
from hopdata.commands.terminal import INTERRUPTED, OK, PROBLEM
from hopdata.errors import HopdataError, did_you_mean

# This module parses the command line and reports errors as one message without a
# traceback.
#
# The commands themselves are in `hopdata.commands`. Each is imported only when it runs,
# so that ``hopdata --help`` answers at once.

#: Table of the commands and their options.
_FILE = Path(__file__).parent / "commands" / "commands.toml"
TABLE: dict[str, Any] = tomllib.loads(_FILE.read_text("utf-8"))
COMMANDS: dict[str, dict[str, Any]] = TABLE["commands"]
for product in products.installed():
    COMMANDS |= product.commands()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    arguments : sequence of str, optional
        Command line without the program's name; by default the one of this process.

    Returns
    -------
    int
        Exit code: 0 for success; 1 for a user's mistake, which is reported on stderr,
        or for a problem in the data; 130 for an interrupt. After a wrong command line
        argparse raises SystemExit with code 2.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    # Arguments after "--" are for Snakemake; argparse would take them for our own.
    own = given.index("--") if given[:1] == ["run"] and "--" in given else len(given)
    options = _parser().parse_args(
        given[:own], argparse.Namespace(passed_on=given[own + 1 :])
    )
    try:
        code: int = resolve_name(options.run)(options)
        sys.stdout.flush()
        return code
    except HopdataError as error:
        print(f"hopdata: error: {error}", file=sys.stderr)
        return PROBLEM
    except (
        BrokenPipeError
    ):  # the reader of our output, such as head, has closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except KeyboardInterrupt:
        print("hopdata: interrupted", file=sys.stderr)
        return INTERRUPTED


class _Parser(argparse.ArgumentParser):
    """A parser that suggests the nearest command for a misspelt one."""

    def _check_value(self, action: argparse.Action, value: object) -> None:
        choices = [str(choice) for choice in action.choices or ()]
        if choices and value not in (action.choices or ()):
            near = did_you_mean(str(value), choices)
            told = f"expected one of {', '.join(choices)}, found '{value}'{near}"
            raise argparse.ArgumentError(action, told)


def _parser() -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = _Parser(
        prog="hopdata",
        description=TABLE["description"],
        epilog=TABLE["overview"] + TABLE["exit_codes"],
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"hopdata {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, told in COMMANDS.items():
        command = commands.add_parser(
            name,
            usage=told.get("usage"),
            help=told["summary"],
            description=told["description"],
            epilog=f"examples:\n{told['examples']}\n{TABLE['exit_codes']}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.set_defaults(run=told["run"])
        of_file = TABLE["recording"] * told.get("reads_file", False)
        for option in (*of_file, *told.get("options", ())):
            given = (
                {**option, "type": TYPES[option["type"]]}
                if "type" in option
                else dict(option)
            )
            command.add_argument(*given.pop("flags"), **given)
    return parser


def completion(_options: argparse.Namespace) -> int:
    """Print the line with which bash, or zsh after bashcompinit, completes commands and files."""
    print(
        f'complete -o default -W "{" ".join(COMMANDS)}" {Path(sys.argv[0]).name or "hopdata"}'
    )
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
    if text != "all" and not (
        text.isdecimal() and int(text)
    ):  # Snakemake waits forever with 0
        raise argparse.ArgumentTypeError(
            f"expected a whole number above 0, or all, found '{text}'"
        )
    return text


#: Types of the options' values, by their names in the table.
TYPES: dict[str, Callable[[str], Any]] = {
    "path": Path,
    "int": int,
    "float": float,
    "positive": _positive,
    "cores": _cores,
    "point": _point,
}


if __name__ == "__main__":
    sys.exit(main())
