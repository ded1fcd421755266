"""Takes from hopdata what Windows lacks, in every Python process that has this folder on its path.

Only modules of hopdata (and what runs as a script) are deprived: Python's own library, NumPy and
Snakemake know the system on which they run. What Windows refuses is refused:

* modules and names of Python that exist only on POSIX systems (posix_only.toml);
* a signal to another process, which ends it there, whatever its number;
* a rename to a name that is taken, and the replacement or removal of a file that is open;
* a text file without a stated encoding, which is not read as UTF-8 there.
"""

import builtins
import os
import subprocess
import sys
import tomllib
import warnings
from pathlib import Path
from types import ModuleType

GONE = tomllib.loads(
    Path(__file__).parents[1].joinpath("posix_only.toml").read_text("utf-8")
)
MODULES = set(GONE.pop("modules"))
POSIX_PATHS = ("/proc", "/dev", "/sys")
STATED = {"sys": {"platform": "win32"}, "os": {"name": "nt"}}
real_import = builtins.__import__


class Deprived(ModuleType):
    """A module without some of its names."""

    def __init__(self, real, gone, stated):
        super().__init__(real.__name__)
        vars(self).update(_real=real, _gone=gone, _stated=stated)

    def __getattr__(self, name):
        if name in self._gone:
            raise AttributeError(f"module '{self.__name__}' has no attribute '{name}'")
        if name in self._stated:
            return self._stated[name]
        return getattr(self._real, name)

    def __setattr__(self, name, value):
        setattr(self._real, name, value)

    def __dir__(self):
        return [*(set(dir(self._real)) - self._gone)]


def is_ours(scope):
    """Tell whether globals are those of hopdata, or of a script."""
    name = (scope or {}).get("__name__") or ""
    return name == "__main__" or name.partition(".")[0] == "hopdata"


def import_without(name, scope=None, local=None, fromlist=(), level=0):
    if level or not is_ours(scope):
        return real_import(name, scope, local, fromlist, level)
    if name in MODULES:
        raise ModuleNotFoundError(f"No module named '{name}'", name=name)
    found = real_import(name, scope, local, fromlist, level)
    return DEPRIVED.get(getattr(found, "__name__", ""), found)


def caller_is_ours():
    return is_ours(sys._getframe(2).f_globals)


def is_open(path):
    """Tell whether this process has a file open."""
    place = os.path.realpath(path)
    for number in os.listdir("/proc/self/fd"):
        try:
            if os.readlink(f"/proc/self/fd/{number}") == place:
                return True
        except OSError:
            continue
    return False


def refuse_open(path):
    if is_open(path):
        raise PermissionError(13, "The file is in use by this process", str(path))


def renaming(real, *, over):
    def rename(source, target, *more, **options):
        if caller_is_ours():
            refuse_open(source)
            refuse_open(target)
            if not over and os.path.lexists(target):
                raise FileExistsError(17, "The name is taken", str(target))
        return real(source, target, *more, **options)

    return rename


def removing(real):
    def remove(path, *more, **options):
        if caller_is_ours():
            refuse_open(path)
        return real(path, *more, **options)

    return remove


def refused(what):
    def refuse(*_, **__):
        raise OSError(1314, f"{what}: a required privilege is not held by the client")

    return refuse


def opening(real):
    """Let hopdata look in vain for folders of POSIX, and require a stated encoding."""

    def opened(file, *arguments, **options):
        if not caller_is_ours():
            return real(file, *arguments, **options)
        name = os.fspath(file) if isinstance(file, str | os.PathLike) else ""
        if name.startswith(POSIX_PATHS) and name != os.devnull:
            raise FileNotFoundError(2, "No such file or directory", name)
        with warnings.catch_warnings():
            warnings.simplefilter("error", EncodingWarning)
            return real(file, *arguments, **options)

    return opened


def starting(real):
    """Let a Python that hopdata isolates from its user find this folder all the same."""

    def start(self, words, *more, **options):
        if caller_is_ours() and isinstance(words, list) and words[1:2] == ["-I"]:
            words = [words[0], "-P", "-s", *words[2:]]
        real(self, words, *more, **options)

    return start


stated_os = STATED["os"] | {
    "rename": renaming(os.rename, over=False),
    "replace": renaming(os.replace, over=True),
    "remove": removing(os.remove),
    "unlink": removing(os.unlink),
    "symlink": refused("symlink"),
    "link": refused("link"),
    "kill": refused("kill"),  # on Windows it ends the process, whatever the signal
}
DEPRIVED = {
    name: Deprived(
        real_import(name), set(gone), {"os": stated_os}.get(name, STATED.get(name, {}))
    )
    for name, gone in (GONE | {"sys": []}).items()
}
Path.rename = renaming(Path.rename, over=False)
Path.replace = renaming(Path.replace, over=True)
Path.unlink = removing(Path.unlink)
Path.open = opening(Path.open)
Path.read_text = opening(Path.read_text)
Path.read_bytes = opening(Path.read_bytes)
Path.write_text = opening(Path.write_text)
builtins.open = opening(builtins.open)
builtins.__import__ = import_without
subprocess.Popen.__init__ = starting(subprocess.Popen.__init__)
warnings.filterwarnings(
    "error", category=EncodingWarning, module=r"hopdata(\.|$)|__main__$"
)
