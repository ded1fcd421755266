"""Code in the working folder, which runs only because the user has named it.

hopdata runs no file of the folder by itself: that is the folder of a study, into which
anyone may have put files. A user names an object there as MODULE:OBJECT.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path

from hopdata.errors import ConfigError, require

#: Variable of the environment with the name of a scene that the user has said; the jobs
#: of a workflow inherit it.
SAID = "HOPDATA_SCENE"

# Modules that a file imports, by the first part of their names.
_IMPORTED = re.compile(r"^[ \t]*(?:from|import)[ \t]+(\w+)", re.MULTILINE)


def is_own(name: str) -> bool:
    """Tell whether a name is of the form MODULE:CLASS."""
    return ":" in name


def say(name: str) -> None:
    """Allow the module of a scene to be imported, here and in what this starts."""
    if not is_own(name):
        raise ConfigError.at("--scene", "MODULE:CLASS", f"'{name}'")
    os.environ[SAID] = name


@contextmanager
def working_folder_last() -> Iterator[None]:
    """Find modules in the working folder, too, where no installed one has the name."""
    folder = os.getcwd()
    sys.path.append(folder)
    try:
        yield
    finally:
        sys.path.remove(folder)


def require_module(module: str, place: str) -> None:
    """Raise a `ConfigError` if the outermost package of a module is not found.

    Parameters
    ----------
    module : str
        Its name, which may have dots.
    place : str
        What the message begins with.
    """
    package = module.partition(".")[0]
    wanted = f"{package}.py in {os.getcwd()}, or an installed package {package}"
    is_found = package.isidentifier() and find_spec(package) is not None
    require(is_found, place, wanted, "neither")


def code_of(name: object) -> dict[str, str]:
    """Return the digests of the files of the working folder that a scene is made of.

    By their paths; a scene of hopdata or of a package has none.
    """
    if not isinstance(name, str) or not is_own(name):
        return {}
    return digests_of(name.partition(":")[0])


def digests_of(module: str) -> dict[str, str]:
    """Return the SHA-256 digests of a module's files in the working folder.

    They are those of its outermost package, and of all other files in the folder that
    these import, by their paths. An installed module has none.
    """
    found: dict[str, str] = {}
    waiting = [module.partition(".")[0]]
    seen = set()
    while waiting:
        name = waiting.pop()
        seen.add(name)
        for file in _files_of(name):
            content = file.read_bytes()
            found[file.as_posix()] = sha256(content).hexdigest()
            text = content.decode("utf-8", errors="replace")
            waiting += {*_IMPORTED.findall(text)} - seen
    return dict(sorted(found.items()))


def _files_of(name: str) -> list[Path]:
    """Return the sources of a module or package in the working folder."""
    package = Path(name)
    if (package / "__init__.py").is_file():
        return sorted(package.rglob("*.py"))
    file = Path(f"{name}.py")
    return [file] if file.is_file() else []
