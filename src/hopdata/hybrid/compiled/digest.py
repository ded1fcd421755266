"""Digests of the driver's sources, and functions named by their digests."""

import hashlib
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any

from hopdata.code_cache import DIGITS, function_digest

PACKAGE = "hopdata.hybrid"
# A module beside the package whose functions build machine code, and its path from it.
BESIDE = {"hopdata.private_numba": "../private_numba.py"}
IMPORT = re.compile(
    rf"^ *from ({re.escape(PACKAGE)}[\w.]*|{'|'.join(map(re.escape, BESIDE))}) "
    r"import (\([^)]*\)|.*)$",
    re.MULTILINE,
)
# They affect where code is kept, or what is said of it, and not the code.
NOT_IN_CODE = ("compiled/digest.py", "compiled/aloud.py")


@cache
def driver_digest() -> str:
    """Return a digest of all sources of the driver, as 16 hexadecimal digits."""
    return sources_digest(Path(__file__).parent.parent)


def sources_digest(package: Path, folder: str = "driver") -> str:
    """Return a digest of a folder of a package and of all modules that it imports."""
    digest = hashlib.sha256()
    for name, source in sorted(driver_sources(package, folder).items()):
        digest.update(name.encode())
        digest.update(source)
    return digest.hexdigest()[:DIGITS]


def in_module_of(digest: str, callback: Any) -> str:
    """Return a digest that also differs with the module of a user's function.

    What is kept of code for other numbers names that module; where another program has
    the same function, it could not be read.
    """
    while hasattr(callback, "inner"):  # derived from the user's
        callback = callback.inner
    whole = f"{digest} {callback.users.__module__}"
    return hashlib.sha256(whole.encode()).hexdigest()[:DIGITS]


def driver_sources(package: Path, folder: str = "driver") -> dict[str, bytes]:
    """Return the sources of the driver, or of another folder, by their paths."""
    found: dict[str, bytes] = {}
    waiting = [f"{folder}/{path.name}" for path in (package / folder).glob("*.py")]
    while waiting:
        name = waiting.pop()
        if name in found or name in NOT_IN_CODE or not (package / name).is_file():
            continue
        found[name] = (package / name).read_bytes()
        waiting += _imported(found[name].decode())
    return found


def _imported(source: str) -> Iterator[str]:
    """Yield the paths of modules that a source may import from the package."""
    for module, names in IMPORT.findall(source):
        if module in BESIDE:
            yield BESIDE[module]
            continue
        path = module.removeprefix(PACKAGE).strip(".").replace(".", "/")
        yield f"{path}.py"
        yield from (f"{path}/{name}.py" for name in re.findall(r"\w+", names))


def with_digest(function: Any, **names: Any) -> FunctionType:
    """Return a copy of a function with its digest in its name and global names added.

    Cached machine code is linked by name, so two functions with the same name, such as
    those of a factory, would be confused. Names are added as globals, because Numba
    does not cache closures.
    """
    known = {**function.__globals__, **names}
    copy = FunctionType(
        function.__code__,
        known,
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    copy.__kwdefaults__ = function.__kwdefaults__
    copy.__module__ = function.__module__
    copy.__qualname__ = f"{function.__qualname__}_{function_digest(copy)}"
    return copy
