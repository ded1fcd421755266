"""``hopdata doctor``: what an installation has, and what it lacks."""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import platform
import shutil
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata import products
from hopdata.bundled import SNAKEFILE
from hopdata.commands import answers
from hopdata.commands.owner import (
    LOCKS,
    is_locked,
    lock_is_dead,
    owners,
    who_is_at_work,
)
from hopdata.commands.terminal import OK, PROBLEM, print_table
from hopdata.provenance import MISSING, version_of

if TYPE_CHECKING:
    from packaging.requirements import Requirement

_FILE = Path(__file__).with_name("dependencies.toml")
USES: dict[str, dict[str, str]] = tomllib.loads(_FILE.read_text("utf-8"))
for product in products.installed():
    known = {**USES["extras"], **product.extras()}
    USES["extras"] = {name: known[name] for name in USES["extras"]}
NEEDED = "needed"


@dataclass(frozen=True)
class Package:
    """A package that hopdata needs, or that an extra brings.

    Attributes
    ----------
    name
        Its name in the registry.
    version
        What is installed, or `MISSING`.
    wanted
        The versions that hopdata works with.
    fits
        Whether such a version is installed.
    """

    name: str
    version: str
    wanted: str
    fits: bool

    @property
    def is_missing(self) -> bool:
        """Whether it is not installed at all."""
        return self.version == MISSING


def doctor(_options: argparse.Namespace) -> int:
    """Report versions, extras, cores, memory and space; code 1 if any lacks."""
    needed = [*packages()]
    extras = {name: [*packages(name)] for name in USES["extras"]}
    facts = _facts()
    problems = [*_problems(needed)]
    _show_facts(facts)
    print()
    _show_needed(needed)
    print()
    _show_extras(extras)
    print()
    print("\n".join(problems) or "nothing is missing")
    answers.give(
        machine=facts,
        needed=[_as_json(one, USES[NEEDED][one.name]) for one in needed],
        extras={
            name: {
                "use": USES["extras"][name],
                "installed": all(one.fits for one in own),
                "packages": [_as_json(one) for one in own],
            }
            for name, own in extras.items()
        },
        problems=problems,
    )
    return PROBLEM if problems else OK


def packages(extra: str = "") -> Iterator[Package]:
    """Yield what hopdata needs here, or what an extra adds, in the order of the list.

    On other systems or versions of Python it may be others.
    """
    from packaging.requirements import Requirement

    for text in importlib.metadata.requires("hopdata") or ():
        one = Requirement(text)
        if _is_of(one, extra):
            version = version_of(one.name)
            fits = version != MISSING and one.specifier.contains(version, True)
            yield Package(one.name.lower(), version, str(one.specifier), fits)


def _is_of(requirement: Requirement, extra: str) -> bool:
    """Tell whether a requirement belongs to an extra; without one, to all."""
    marker = requirement.marker
    is_general = marker is None or marker.evaluate({"extra": ""})
    if not extra:
        return is_general
    return not is_general and marker is not None and marker.evaluate({"extra": extra})


def _facts() -> dict[str, str]:
    """Return what there is beside packages, in words."""
    n_compiled = _n_compiled()
    here = Path.cwd()
    compiled = f"{n_compiled} functions" if n_compiled else "none; once, some 20 s"
    machine = f"{platform.system()} {platform.machine()}"
    return {
        "hopdata": version_of("hopdata"),
        "python": f"{platform.python_version()}, {machine}",
        "cores": str(_n_cores()),
        "memory": _memory(),
        "workflow": str(SNAKEFILE),
        "compiled": compiled,
        "this folder": f"{here}, {shutil.disk_usage('.').free / 1e9:.1f} GB free",
    }


def _problems(needed: list[Package]) -> Iterator[str]:
    """Yield what a study cannot run with."""
    for one in needed:
        if not one.fits:
            found = "found none" if one.is_missing else f"found {one.version}"
            wanted = f"expected {one.wanted or 'any version'}"
            yield f"{one.name}: {wanted}, {found}; install hopdata anew"
    if not SNAKEFILE.exists():
        wanted = "expected the workflow, found no file; install hopdata anew"
        yield f"{SNAKEFILE}: {wanted}"
    here = Path.cwd()
    if not os.access(here, os.W_OK):
        yield f"{here}: expected a folder that can be written; go to another"
    if is_locked():
        yield f"{LOCKS}: {_why_locked()}"


def _show_facts(facts: dict[str, str]) -> None:
    print_table(
        {"": "left", "this installation": "left"},
        facts.items(),
        plain="\n".join(f"{name:12} {what}" for name, what in facts.items()),
    )


def _show_needed(needed: list[Package]) -> None:
    rows = [(one.name, one.version, USES[NEEDED][one.name]) for one in needed]
    lines = [f"{name:14} {version:14} {use}" for name, version, use in rows]
    print_table(
        {"a study needs": "left", "version": "left", "for": "left"},
        rows,
        plain="\n".join(["a study needs", *(f"  {line}" for line in lines)]),
    )


def _show_extras(extras: dict[str, list[Package]]) -> None:
    rows = []
    for name, own in extras.items():
        # Nothing of an extra may exist on this system.
        told = ", ".join(f"{one.name} {one.version}" for one in own) or "not to be had"
        rows.append((name, told, USES["extras"][name]))
    lines = [f"{name:14} {told:27} {use}" for name, told, use in rows]
    title = "extras, as in pip install 'hopdata[excel]'"
    print_table(
        {"extra": "left", "what it brings": "left", "for": "left"},
        rows,
        plain="\n".join([title, *(f"  {line}" for line in lines)]),
    )


def _as_json(package: Package, use: str = "") -> dict[str, Any]:
    told = {
        "name": package.name,
        "version": None if package.is_missing else package.version,
        "wanted": package.wanted,
        "fits": package.fits,
    }
    return told | {"use": use} if use else told


def _n_compiled() -> int:
    """Return the number of functions whose machine code is kept."""
    import hopdata

    places = [Path(hopdata.__file__).parent, Path("~/.cache/hopdata").expanduser()]
    numba_cache = os.environ.get("NUMBA_CACHE_DIR")
    if numba_cache:
        places.append(Path(numba_cache))
    return sum(len([*place.rglob("*.nbi")]) for place in places)


def _n_cores() -> int | None:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count()


def _why_locked() -> str:
    if lock_is_dead():
        killed = " and ".join(map(str, owners().values()))
        return f"{killed} was killed; the next 'hopdata run' here removes its lock"
    return who_is_at_work()


def _memory() -> str:
    with suppress(ValueError, OSError, AttributeError):
        page = os.sysconf("SC_PAGE_SIZE")
        whole = page * os.sysconf("SC_PHYS_PAGES") / 1e9
        free = page * os.sysconf("SC_AVPHYS_PAGES") / 1e9
        return f"{whole:.1f} GB, {free:.1f} GB free"
    return "not known here"
