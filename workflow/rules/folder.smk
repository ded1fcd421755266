import os
import shlex
import sys
import time
from contextlib import suppress
from pathlib import Path

# Snakemake refuses a locked folder, and does not say with which command it is unlocked.
if (
    workflow.is_main_process
    and "--unlock" not in sys.argv
    and any(Path(".snakemake/locks").glob("*.output.lock"))
):
    is_module = sys.argv[0].endswith("__main__.py")
    program = [sys.executable, "-m", "snakemake"] if is_module else sys.argv[:1]
    print(
        "hopdata: .snakemake/locks: another run is at work in this folder, or one was killed; if "
        f"Snakemake refuses to start and no other runs: {shlex.join([*program, *sys.argv[1:]])} --unlock",
        file=sys.stderr,
    )
SKEW_S = 60  # by so much may the clocks of two machines differ


def stamps(files):
    """Names, sizes and times of the files that are there.

    Snakemake compares times only for which is later: one with an older time that took the place of
    another, or came while the clock was wrong, would go unnoticed.
    """
    found = []
    for file in files:
        with suppress(OSError):
            status = os.stat(file)
            found.append((str(file), status.st_size, status.st_mtime_ns))
    return found


def warn_of_times_ahead(files, folder):
    """Say which of the files, or of the results in the folder, is dated after now."""
    if not workflow.is_main_process:
        return
    made = (os.path.join(place, name) for place, _, names in os.walk(folder) for name in names)
    latest = (time.time() + SKEW_S) * 1e9
    for kept, mend in ((files, "touch it"), (made, "run once with --force, or --forceall")):
        ahead = [name for name, _, changed in stamps(kept) if changed > latest]
        if ahead:
            print(
                f"hopdata: {ahead[0]}: expected a time before now, found one after it: a clock is or was "
                f"wrong, and times say what is to be made anew; {mend}",
                file=sys.stderr,
            )


onstart:
    # Scripts that Snakemake wrote out for jobs of a run that was killed; a run beside this one may
    # be at work with its own.
    if len(list(Path(".snakemake/locks").glob("*.output.lock"))) == 1:
        for left in Path(".snakemake/scripts").glob("tmp*"):
            left.unlink(missing_ok=True)
    # The limit of starts in time is meant for clusters: here it lets each run wait a second more,
    # and there is no option without it.
    if getattr(workflow, "local_exec", False) and hasattr(workflow, "scheduler"):
        workflow.scheduler.job_rate_limiter = None
