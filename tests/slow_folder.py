# ruff: noqa: ARG002 -- FUSE gives each of its calls what only some of them need
"""A folder whose every operation takes some time, as over a busy network: for `make test-cluster`.

python tests/slow_folder.py FOLDER MOUNTED_AT DELAY_MS [STALE_S]

Files are those of FOLDER. Each call by a name waits; where STALE_S is given, the names in
a folder and the sizes of files are seen by the kernel as they were up to so many seconds ago, as
with NFS. Needs root (or fusermount) and `pip install mfusepy`.
"""

import os
import sys
import time
from functools import wraps
from pathlib import Path

import mfusepy

# What stands in the place of a time, in Linux: the time of the call, and none.
UTIME_NOW, UTIME_OMIT = (1 << 30) - 1, (1 << 30) - 2

# What takes its time; reading and writing of open files do not.
CALLS = {
    *("access", "getattr", "readdir", "chmod", "create", "open", "truncate", "fsync"),
    *("mkdir", "rmdir", "unlink", "rename", "link", "symlink", "readlink", "utimens"),
}


class SlowFolder(mfusepy.Operations):
    """Hands each call on to a folder, after a delay."""

    use_ns = True

    def __init__(self, folder, delay_s):
        self.folder = Path(folder).resolve()
        self.delay_s = delay_s

    def __getattribute__(self, name):
        found = super().__getattribute__(name)
        if name not in CALLS:
            return found

        @wraps(found)
        def slow(*arguments):
            time.sleep(self.delay_s)
            return found(*arguments)

        return slow

    def real(self, path):
        return f"{self.folder}{path}"

    def access(self, path, amode):
        if not os.access(self.real(path), amode):
            raise mfusepy.FuseOSError(13)
        return 0

    def getattr(self, path, fh=None):
        found = os.lstat(self.real(path))
        keys = ("mode", "nlink", "size", "uid", "gid", "ino", "dev")
        times = {
            f"st_{k}": getattr(found, f"st_{k}_ns") for k in ("atime", "mtime", "ctime")
        }
        return {f"st_{key}": getattr(found, f"st_{key}") for key in keys} | times

    def readdir(self, path, fh):
        return [".", "..", *os.listdir(self.real(path))]

    def chmod(self, path, mode):
        os.chmod(self.real(path), mode)
        return 0

    def chown(self, path, uid, gid):
        os.chown(self.real(path), uid, gid)
        return 0

    def create(self, path, mode, fi=None):
        return os.open(self.real(path), os.O_RDWR | os.O_CREAT | os.O_TRUNC, mode)

    def open(self, path, flags):
        return os.open(self.real(path), flags)

    def read(self, path, size, offset, fh):
        return os.pread(fh, size, offset)

    def write(self, path, data, offset, fh):
        return os.pwrite(fh, data, offset)

    def truncate(self, path, length, fh=None):
        os.truncate(self.real(path) if fh is None else fh, length)
        return 0

    def flush(self, path, fh):
        return 0

    def fsync(self, path, datasync, fh):
        os.fsync(fh)
        return 0

    def release(self, path, fh):
        os.close(fh)
        return 0

    def mkdir(self, path, mode):
        os.mkdir(self.real(path), mode)
        return 0

    def rmdir(self, path):
        os.rmdir(self.real(path))
        return 0

    def unlink(self, path):
        os.unlink(self.real(path))
        return 0

    def rename(self, old, new, flags=0):
        os.rename(self.real(old), self.real(new))
        return 0

    def link(self, target, source):
        os.link(self.real(source), self.real(target))
        return 0

    def symlink(self, target, source):
        os.symlink(source, self.real(target))
        return 0

    def readlink(self, path):
        return os.readlink(self.real(path))

    def utimens(self, path, times=None):
        if times is not None:
            found = os.lstat(self.real(path))
            kept = (found.st_atime_ns, found.st_mtime_ns)
            meant = {UTIME_NOW: (time.time_ns(),) * 2, UTIME_OMIT: kept}
            times = tuple(
                meant.get(one, times)[which] for which, one in enumerate(times)
            )
        os.utime(self.real(path), ns=times)
        return 0

    def statfs(self, path):
        found = os.statvfs(self.real(path))
        keys = (
            "bavail",
            "bfree",
            "blocks",
            "bsize",
            "favail",
            "ffree",
            "files",
            "frsize",
            "namemax",
        )
        return {f"f_{key}": getattr(found, f"f_{key}") for key in keys}


if __name__ == "__main__":
    folder, at, delay_ms, *stale = sys.argv[1:]
    seen_s = float(stale[0]) if stale else 0.0
    mfusepy.FUSE(
        SlowFolder(folder, float(delay_ms) / 1e3),
        at,
        foreground=True,
        nothreads=False,
        allow_other=True,
        attr_timeout=seen_s,
        entry_timeout=seen_s,
        negative_timeout=seen_s,
    )
