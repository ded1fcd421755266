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
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from hopdata import __version__, products
from hopdata.commands.terminal import INTERRUPTED, OK, PROBLEM, screened
from hopdata.errors import HopdataError, did_you_mean
from hopdata.foreign.settings import leave_unread
from hopdata.foreign.working_folder import say

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
    for target, about in product.targets().items():
        COMMANDS["run"]["examples"] += f"  hopdata run {target:32} {about['summary']}\n"


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
    leave_unread()
    with screened():
        return _command(list(sys.argv[1:] if arguments is None else arguments))


def _command(given: list[str]) -> int:
    own, passed_on = _apart(given)
    options = _parser().parse_args(own, argparse.Namespace(passed_on=passed_on))
    for fault in products.faults().values():
        print(f"hopdata: note: {fault}", file=sys.stderr)
    try:
        _check_folder()
        with _blamed(options.run):
            code = _run(options)
        sys.stdout.flush()
        return code
    except HopdataError as error:
        print(f"hopdata: error: {error}", file=sys.stderr)
        return PROBLEM
    except BrokenPipeError:
        # The reader of our output, such as head, has closed the pipe.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except KeyboardInterrupt:
        print("hopdata: interrupted", file=sys.stderr)
        return INTERRUPTED


def _run(options: argparse.Namespace) -> int:
    command: Callable[[argparse.Namespace], int] = resolve_name(options.run)
    if getattr(options, "scene", None) is not None:
        say(options.scene)
    if getattr(options, "json", False):
        from hopdata.commands.answers import in_json

        return in_json(options, options.command, command)
    return command(options)


def _check_folder() -> None:
    """Check that the current folder, from which paths count, still exists."""
    try:
        os.getcwd()
    except OSError:
        message = "expected a current folder, found that it has been removed"
        raise HopdataError(f"{message}; change to one that exists (cd)") from None


def _blamed(run: str) -> AbstractContextManager[None]:
    """Return a context in which errors of a product's command are told as such."""
    for product in products.installed():
        if run.partition(":")[0].startswith(f"{product.package}."):
            return product.blamed()
    return nullcontext()


def _apart(given: list[str]) -> tuple[list[str], list[str]]:
    """Return our own arguments, and those for Snakemake, which follow a "--".

    Argparse would take the latter for our own.
    """
    if given[:1] == ["run"] and "--" in given:
        end = given.index("--")
        return given[:end], given[end + 1 :]
    return given, []


class _Parser(argparse.ArgumentParser):
    """A parser that suggests the nearest command for a misspelt one.

    Its help is plain text: what it would tell a terminal, from Python 3.14 on, does not
    pass `screened`.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.color = False

    def _check_value(self, action: argparse.Action, value: object) -> None:
        choices = list(action.choices or ())
        if choices and value not in choices:
            names = [str(choice) for choice in choices]
            near = did_you_mean(str(value), names)
            message = f"expected one of {', '.join(names)}, found '{value}'{near}"
            raise argparse.ArgumentError(action, message)


def _parser(completes: Mapping[str, Any] | None = None) -> argparse.ArgumentParser:
    """Return the parser of the whole command line.

    Parameters
    ----------
    completes : mapping, optional
        How each shell completes the values of options, by what they are: see
        `hopdata.commands.completion`.
    """
    parser: argparse.ArgumentParser = _Parser(
        prog="hopdata",
        usage="%(prog)s [-h] [--version] COMMAND ...",
        description=TABLE["description"],
        epilog=_commands_listed() + TABLE["overview"] + TABLE["exit_codes"],
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"hopdata {__version__}")
    # The commands are listed under headings of their own; completion needs them here.
    told = argparse.SUPPRESS if completes is None else "commands"
    commands = parser.add_subparsers(
        metavar="COMMAND", required=True, dest="command", help=told
    )
    for name, entry in COMMANDS.items():
        command = commands.add_parser(
            name,
            usage=entry.get("usage"),
            help=entry["summary"],
            description=entry["description"],
            epilog=f"examples:\n{entry['examples']}\n{TABLE['exit_codes']}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.set_defaults(run=entry["run"])
        if entry.get("reads_file"):
            _add_options(command, TABLE["recording"], completes)
        _add_options(command, entry.get("options", []), completes)
        for common in ("scene", "json"):
            if entry.get(common):
                _add_options(command, TABLE[common], completes)
    return parser


def _commands_listed() -> str:
    """List the commands with their summaries, under the headings of their groups."""
    groups: dict[str, list[str]] = {group: [] for group in TABLE["groups"]}
    width = max(map(len, COMMANDS))
    for name, entry in COMMANDS.items():
        line = f"  {name:{width}}  {entry['summary']}"
        groups.setdefault(entry.get("group", "further commands"), []).append(line)
    listed = ""
    for group, lines in groups.items():
        listed += f"{group}:\n" + "\n".join(lines) + "\n\n"
    return listed


def _add_options(
    command: argparse.ArgumentParser,
    options: list[dict[str, Any]],
    completes: Mapping[str, Any] | None,
) -> None:
    for option in options:
        given = dict(option)
        flags = given.pop("flags")
        is_path = given.get("type") == "path"
        kind = given.pop("completes", "file" if is_path else None)
        if "type" in given:
            given["type"] = TYPES[given["type"]]
        action = command.add_argument(*flags, **given)
        if completes is not None and kind is not None:
            action.complete = completes[kind]  # type: ignore[attr-defined]


def completion(options: argparse.Namespace) -> int:
    """Print the script by which a shell completes the command line."""
    from hopdata.commands.completion import COMPLETES, script

    print(script(_parser(COMPLETES), options.shell))
    return OK


# Types of the options' values.


def _point(text: str) -> tuple[float, ...]:
    with suppress(ValueError):
        x, y = map(float, text.split(","))
        return x, y
    raise argparse.ArgumentTypeError(f"expected X,Y, found '{text}'")


def _positive(text: str) -> float:
    with suppress(ValueError):
        value = float(text)
        if 0 < value < float("inf"):
            return value
    raise argparse.ArgumentTypeError(f"expected a number above 0, found '{text}'")


def _cores(text: str) -> str:
    # Snakemake would wait for ever with 0.
    is_number = text.isdecimal() and int(text) > 0
    if text != "all" and not is_number:
        wanted = "expected a whole number above 0, or all"
        raise argparse.ArgumentTypeError(f"{wanted}, found '{text}'")
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
