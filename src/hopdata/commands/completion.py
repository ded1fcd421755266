"""What a shell completes: configurations, studies, stages and files.

Each kind of value has a pattern for each shell, as `shtab` takes it. Bash calls a
function that prints the candidates; zsh and tcsh have patterns of their own. Names of
stages and targets are those of this installation, and written into the script; files
are looked for as the user types.
"""

from __future__ import annotations

import argparse
from typing import Any

import shtab

from hopdata import products
from hopdata.stages import LINE


def _files(name: str, *patterns: str, words: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return how files of some patterns are completed, and words beside them.

    Any path may follow, as the folder may be organised otherwise.
    """
    found = " ".join(f"$(compgen -G '{pattern}')" for pattern in patterns)
    candidates = " ".join([found, *words])
    function = f"_hopdata_{name}"
    bash = (
        f"{function}() {{\n"
        f'  compgen -W "{candidates}" -- "$1"\n'
        '  [ -z "$1" ] || _shtab_compgen_files "$1"\n'
        "}"
    )
    globs = " ".join(f"{pattern}(N)" for pattern in patterns)
    zsh = (
        f"{function}() {{\n"
        f"  local -a found=({globs} {' '.join(words)})\n"
        '  compadd -a found\n  [[ -z "$PREFIX" ]] || _files\n}'
    )
    return {
        "bash": function,
        "zsh": function,
        "tcsh": "f",
        "preamble": {"bash": bash, "zsh": zsh},
    }


def _words(name: str, words: tuple[str, ...]) -> dict[str, Any]:
    """Return how one of some words is completed."""
    listed = " ".join(words)
    function = f"_hopdata_{name}"
    bash = f'{function}() {{\n  compgen -W "{listed}" -- "$1"\n}}'
    return {
        "bash": function,
        "zsh": f"({listed})",
        "tcsh": f"({listed})",
        "preamble": {"bash": bash},
    }


CONFIGS = ("config/*.yaml", "config/*.yml")
_TARGETS = tuple(name for one in products.installed() for name in one.targets())

#: How values are completed, by the names that ``completes`` has in the tables of
#: commands.
COMPLETES: dict[str, Any] = {
    "file": shtab.FILE,
    "config": _files("configs", *CONFIGS),
    "study": _files("studies", *CONFIGS, words=_TARGETS),
    "pilot": _files("pilots", "results/*/verdict.json", *CONFIGS),
    "record": _files("records", "results/*/provenance.json"),
    "model": _files("models", "results/*/steering/seeds/*"),
    "stage": _words("stages", tuple(LINE.stages)),
}


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """Return the script by which a shell completes the command line of a parser."""
    return str(shtab.complete(parser, shell=shell))
