"""The commands of benchmarks in the documents are ones that these programs take."""

from __future__ import annotations

import argparse
import ast
import re
import shlex
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("benchmarks/*.md")]
COMMAND = re.compile(r"python (?P<program>benchmarks/\w+\.py)(?P<rest>[^`\n]*)")
# What decides whether a command is taken, but for the kinds of its values.
READ = ("nargs", "action", "required")


def commands():
    """Yield page, program and arguments of each command."""
    for page in sorted(PAGES):
        for found in COMMAND.finditer(page.read_text(encoding="utf-8")):
            yield page.name, found["program"], shlex.split(found["rest"], comments=True)


def refused(program, arguments):
    """Return what the program says of arguments that it does not take; "" if it does.

    Its options are read from its source, without what it imports.
    """
    parser = argparse.ArgumentParser(exit_on_error=False)
    source = (ROOT / program).read_text(encoding="utf-8")
    if "read_options(" in source:  # those that several programs share
        source += (
            (ROOT / "benchmarks/campaigns.py")
            .read_text(encoding="utf-8")
            .replace("from __future__ import annotations", "")
        )
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and getattr(node.func, "attr", "") == (
            "add_argument"
        ):
            names = [ast.literal_eval(one) for one in node.args]
            options = {}
            for one in node.keywords:
                if one.arg in READ:
                    options[one.arg] = ast.literal_eval(one.value)
            parser.add_argument(*names, **options)
    try:
        parser.parse_args(arguments)
    except (argparse.ArgumentError, SystemExit) as error:
        return f"{program}: {error}"
    return ""


def test_there_are_commands():
    assert len(list(commands())) > 15


@pytest.mark.parametrize(("page", "program", "arguments"), list(commands()))
def test_each_command_is_taken(page, program, arguments):
    assert not refused(program, arguments), page


def test_a_missing_and_an_unknown_option_are_noticed():
    assert refused("benchmarks/stress.py", [])
    assert refused("benchmarks/stress.py", ["--out", "x.csv", "--nothing"])
    assert not refused("benchmarks/stress.py", ["--out", "x.csv"])
