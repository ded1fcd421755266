"""Provenance of a result: code, versions, inputs, seeds and the time of each stage."""

import hashlib
import importlib.metadata
import math
import platform
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from hopdata import __version__
from hopdata.foreign.working_folder import code_of

PACKAGE = Path(__file__).parent
# Suffixes of files, beside Python's, from which results follow.
ASSETS = {".bib", ".css", ".j2", ".mplstyle", ".toml", ".yaml"}
# Packages whose versions are recorded.
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
    r"^[ \t]*(?:from[ \t]+(hopdata[\w.]*)[ \t]+import[ \t]+"
    r"(\((?:[^)#]|#[^\n]*)*\)|[^\n]*)"
    r"|import[ \t]+(hopdata[^\n]*))",
    re.MULTILINE,
)
# A class or function named in a table, and imported on demand.
NAMED = re.compile(r'"(hopdata\.[\w.]+):\w+"')


def code_digest(script: str | Path) -> str:
    """Return a digest of a script and of every hopdata source that it imports.

    This includes what these import in turn. Imports are read from the text, including
    those inside functions, so nothing is executed. A rule that has this digest as a
    parameter runs again when its library code changes.
    """
    script = Path(script).resolve()
    digest = hashlib.sha256()
    # The script comes first: sorted with the modules, its place would depend on the
    # install path.
    for source in (script, *sorted(_closure(_imports(script)))):
        _add(digest, source)
    return digest.hexdigest()[:16]


def _add(digest: Any, source: Path) -> None:
    """Add a source to a digest, with the other files of its package if it is one."""
    digest.update(source.name.encode())
    digest.update(source.read_bytes())
    for asset in _assets(source):
        digest.update(asset.read_bytes())


def stage_digest(
    texts: Iterable[str], modules: Iterable[str], script: str | Path
) -> str:
    """Return a digest of a stage and of every hopdata source that its function imports.

    Parameters
    ----------
    texts
        What says what it does: the texts of the function and of its results' class.
    modules
        Modules that read and write its files.
    script
        Script that runs it; what this imports is not followed, since that is every
        stage.
    """
    started = {path for name in modules for path in _module_files(name)}
    started |= {path for text in texts for path in _imported_in(text)}
    machinery = [Path(script), PACKAGE / "line.py"]
    digest = hashlib.sha256()
    for text in texts:
        digest.update(text.encode())
    for source in (*machinery, *sorted(_closure(started))):
        _add(digest, source)
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
    """Return the files of hopdata that `source` imports, with their parent packages."""
    return _imported_in(source.read_text(encoding="utf-8"))


def _imported_in(text: str) -> frozenset[Path]:
    names: set[str] = set()
    names.update(NAMED.findall(text))
    for module, imported, modules in IMPORT.findall(text):
        names.update(
            [module, *(f"{module}.{name}" for name in re.findall(r"\w+", imported))]
        )
        names.update(re.findall(r"[\w.]+", modules))
    return frozenset(path for name in names for path in _module_files(name))


@cache
def _module_files(name: str) -> frozenset[Path]:
    """Return the files of a module and of the packages that it is in."""
    package, _, _ = name.rpartition(".")
    own = _modules().get(name, frozenset())
    if not package:
        return own
    return own | _module_files(package)


@cache
def _modules() -> dict[str, frozenset[Path]]:
    """Return the files of each module, by its name."""
    files: dict[str, frozenset[Path]] = {}
    for source in _sources():
        *folders, file = source.relative_to(PACKAGE.parent).parts
        module = file.removesuffix(".py")
        if module != "__init__":
            folders.append(module)
        name = ".".join(folders)
        files[name] = files.get(name, frozenset()) | {source}
    return files


@cache
def _sources() -> frozenset[Path]:
    """Return all modules, without the workflow's scripts, which a wheel also holds."""
    scripts = PACKAGE.glob("_workflow/**/*.py")
    return frozenset(PACKAGE.rglob("*.py")) - frozenset(scripts)


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
        "own_code_sha256": own_code(config),
        "versions": {name: version_of(name) for name in REPORTED},
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "stage_seconds": _seconds_of(stage_times),
    }


def own_code(config: Mapping[str, Any]) -> dict[str, str]:
    """Return the digests of the user's files that a study has run, by their paths.

    They are those of a scene in the working folder.
    """
    entries = config.get("recordings") or []
    if all(entry.get("file") for entry in entries):
        return {}
    return code_of((config.get("simulation") or {}).get("scene"))


def package_digest() -> str:
    """Return a digest of all sources, which also differs within a version."""
    sources = set(_sources())
    for room in PACKAGE.rglob("__init__.py"):
        sources.update(_assets(room))
    digest = hashlib.sha256()
    for source in sorted(sources):
        digest.update(str(source.relative_to(PACKAGE)).encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()


def version_of(name: str) -> str:
    """Return the version of an installed package, or `MISSING`."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return __version__ if name == "hopdata" else MISSING


def _seconds_of(stage_times: Iterable[Path]) -> dict[str, float]:
    """Return the time that each job took; a damaged file is left out.

    Snakemake writes these files itself, so that they have no digest. They are not made
    again, and no result hangs on them.
    """
    found = {}
    for path in sorted(stage_times):
        with suppress(OSError, ValueError, KeyError):
            found[path.stem] = _seconds(path)
    return found


def _seconds(path: Path) -> float:
    """Return the time that a job took, from its benchmark file."""
    header, first = path.read_text(encoding="utf-8").splitlines()[:2]
    columns = dict(zip(header.split("\t"), first.split("\t"), strict=True))
    seconds = float(columns["s"])
    if not math.isfinite(seconds):
        raise ValueError(seconds)
    return seconds
