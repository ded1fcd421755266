"""Provenance of a result: code, versions, inputs, seeds and the time of each stage."""

import hashlib
import importlib.metadata
import platform
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from hopdata import __version__

PACKAGE = Path(__file__).parent
ASSETS = {".css", ".j2", ".mplstyle", ".toml", ".yaml"}
REPORTED = [
    "hopdata",
    "numpy",
    "scipy",
    "pandas",
    "matplotlib",
    "h5py",
    "numba",
    "snakemake",
]
MISSING = "not installed"
# Matches `from hopdata... import ...`, also over several lines, and `import
# hopdata...`. Parsing all sources instead would take half as long as the shortest
# study.
IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+(hopdata[\w.]*)[ \t]+import[ \t]+(\((?:[^)#]|#[^\n]*)*\)|[^\n]*)"
    r"|import[ \t]+(hopdata[^\n]*))",
    re.MULTILINE,
)
NAMED = re.compile(
    r'"(hopdata\.[\w.]+):\w+"'
)  # a class named in a table and imported on demand


def code_digest(script: str | Path) -> str:
    """Return a digest of a script and of every hopdata source that it imports, directly or not.

    Imports are read from the text, including those inside functions, so nothing is
    executed. A rule that has this digest as a parameter runs again when its library
    code changes.
    """
    script = Path(script).resolve()
    digest = hashlib.sha256()
    # The script comes first: sorted with the modules, its place would depend on the
    # install path.
    for source in (script, *sorted(_closure(_imports(script)))):
        digest.update(source.name.encode())
        digest.update(source.read_bytes())
        for asset in _assets(source):
            digest.update(asset.read_bytes())
    return digest.hexdigest()[:16]


@cache
def _assets(source: Path) -> tuple[Path, ...]:
    """Return the non-Python files of a sub-package (style sheets, templates, schemas).

    Those of a package within it are that package's own: a text on the command line of
    steering is no part of the code that learns its model.
    """
    folder = source.parent
    if source.name != "__init__.py" or folder == PACKAGE:
        return ()
    found = (p for p in folder.rglob("*") if p.suffix in ASSETS and p.is_file())
    return tuple(sorted(p for p in found if _package_of(p) == folder))


def _package_of(file: Path) -> Path:
    """Return the folder of the package that a file is in."""
    return next(one for one in file.parents if (one / "__init__.py").is_file())


def _closure(start: Iterable[Path]) -> set[Path]:
    seen: set[Path] = set()
    waiting = set(start)
    while waiting:
        seen |= waiting
        waiting = {one for source in waiting for one in _imports(source)} - seen
    return seen


@cache
def _imports(source: Path) -> frozenset[Path]:
    """Return the files of this package that `source` imports, with their parent packages."""
    names: set[str] = set()
    text = source.read_text(encoding="utf-8")
    names.update(NAMED.findall(text))
    for module, imported, modules in IMPORT.findall(text):
        names.update(
            [module, *(f"{module}.{name}" for name in re.findall(r"\w+", imported))]
        )
        names.update(re.findall(r"[\w.]+", modules))
    return frozenset(path for name in names for path in _module_files(name))


@cache
def _module_files(name: str) -> frozenset[Path]:
    package, *parts = name.split(".")
    if package != PACKAGE.name:
        return frozenset()
    bases = [PACKAGE.joinpath(*parts[:depth]) for depth in range(len(parts) + 1)]
    packages = {base / "__init__.py" for base in bases}
    return _sources() & packages.union(base.with_suffix(".py") for base in bases)


@cache
def _sources() -> frozenset[Path]:
    """Return all modules, without the workflow's scripts that an installed package also holds."""
    return frozenset(PACKAGE.rglob("*.py")) - frozenset(
        PACKAGE.glob("_workflow/**/*.py")
    )


def provenance(
    config: Mapping[str, Any],
    inputs: Mapping[str, str],
    stage_times: Iterable[Path] = (),
) -> dict[str, Any]:
    """Collect what is needed to reproduce a study.

    Parameters
    ----------
    config : mapping
        The validated configuration with defaults filled in.
    inputs : mapping
        Name of the source file -> SHA-256 digest, one entry per recording.
    stage_times : iterable of paths
        Snakemake benchmark files, one per job.
    """
    return {
        "study": config["study"],
        "seed": config["seed"],
        "config": dict(config),
        "inputs": dict(inputs),
        "code_sha256": package_digest(),
        "versions": {name: version_of(name) for name in REPORTED},
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "stage_seconds": {path.stem: _seconds(path) for path in sorted(stage_times)},
    }


def package_digest() -> str:
    """Return a digest of all sources of the package, which also differs within one version."""
    digest = hashlib.sha256()
    assets = (
        one
        for folder in sorted(PACKAGE.rglob("__init__.py"))
        for one in _assets(folder)
    )
    for source in sorted(_sources().union(assets)):
        digest.update(str(source.relative_to(PACKAGE)).encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()


def version_of(name: str) -> str:
    """Return the version of an installed package, or `MISSING`."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return __version__ if name == "hopdata" else MISSING


def _seconds(path: Path) -> float:
    header, first = path.read_text(encoding="utf-8").splitlines()[:2]
    return float(dict(zip(header.split("\t"), first.split("\t"), strict=True))["s"])
