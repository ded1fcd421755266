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


def check_times(files, folder):
    """Refuse files dated after now, whose results Snakemake would refuse, and name such results."""
    if not workflow.is_main_process:
        return
    made = (os.path.join(place, name) for place, _, names in os.walk(folder) for name in names)
    latest = (time.time() + SKEW_S) * 1e9
    read, kept = ([one[0] for one in stamps(x) if one[2] > latest] for x in (files, made))
    told = "expected a time before now, found a later one: a clock is or was wrong"
    if read:
        sys.exit(f"hopdata: error: {read[0]}: {told}; touch it and run again")
    if kept:
        print(
            f"hopdata: {kept[0]}: {told}, and times say what is to be made anew; run once with "
            "--force, or --forceall",
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
