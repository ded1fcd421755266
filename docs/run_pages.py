"""Run the code of the pages that say so, for the site: ``python docs/run_pages.py``.

Each page has a process of its own; the first that fails ends all others, and is told
with its cell and its traceback. Sphinx could run them too. But it hands out pages in
alphabetical bundles, of which the last ones run alone, and it may wait for ever after
one has failed.
"""

import argparse
import asyncio
import re
import shutil
import sys
import time
from pathlib import Path

import nbformat
from executed_pages import RAN, RUNS, as_written, place_of
from nbclient import NotebookClient

ROOT = Path(__file__).parents[1]
PLACES = ("*.md", "docs/*.md", "benchmarks/**/README.md")

#: The pages that take longest, which are begun first, so that none of them is the last.
DEAR = (
    "first_study",
    "notebook",
    "sliding",
    "prediction",
    "gallery",
    "gradients",
    "integrator_many",
    "steering",
    "plan",
)

#: Time for a cell and for a page, beyond which it fails.
#: Unit: s. Origin: chosen: twelve times what the slowest take on two cores: a page that
#: runs beside the tests has what these leave of them.
CELL_S, PAGE_S = 480, 1200

COLOURS = re.compile(r"\x1b\[[0-9;]*m")


def pages_that_run() -> list[Path]:
    """Return the pages whose code is run, those that take longest first."""
    every = [path for place in PLACES for path in sorted(ROOT.glob(place))]
    found = [path for path in every if RUNS in path.read_text(encoding="utf-8")]
    return sorted(found, key=lambda path: path.stem not in DEAR)


async def run(path: Path, free: asyncio.Semaphore, seconds: dict[str, float]) -> None:
    """Run a page, when one of the jobs is free, and keep its results."""
    page = as_written(path.read_text(encoding="utf-8"))
    client = NotebookClient(
        page,
        timeout=CELL_S,
        kernel_name="python3",
        resources={"metadata": {"path": str(path.parent)}},
        extra_arguments=["--log-level=ERROR"],
        shutdown_kernel="immediate",
    )
    async with free:
        start = time.perf_counter()
        limit = asyncio.timeout(PAGE_S)
        try:
            async with limit:
                await client.async_execute()
        except Exception:
            # nbclient says that the kernel died where it was ended.
            if limit.expired():
                raise RuntimeError(f"it took more than {PAGE_S} s") from None
            raise
        finally:
            seconds[path.stem] = time.perf_counter() - start
    nbformat.write(page, place_of(page))


async def run_all(jobs: int) -> dict[str, float]:
    """Run all pages, a number at a time; return the seconds of each.

    Raises
    ------
    RuntimeError
        If one fails; the others are ended.
    """
    free = asyncio.Semaphore(jobs)
    seconds: dict[str, float] = {}
    tasks = {
        asyncio.create_task(run(path, free, seconds)): path for path in pages_that_run()
    }
    done, others = await asyncio.wait(tasks, return_when=asyncio.FIRST_EXCEPTION)
    # What nbclient leaves behind of pages that are ended is not what failed.
    asyncio.get_running_loop().set_exception_handler(lambda *_: None)
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)
    for task in done:
        error = task.exception()
        if error is not None:
            where = tasks[task].relative_to(ROOT)
            raise RuntimeError(f"{where}: its code fails\n{error}") from error
    return seconds


def main() -> None:
    """Run all pages, and say which take longest."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--jobs", type=int, default=2, help="pages at a time")
    shutil.rmtree(RAN, ignore_errors=True)
    RAN.mkdir(parents=True)
    try:
        seconds = asyncio.run(run_all(options.parse_args().jobs))
    except RuntimeError as error:
        sys.exit(COLOURS.sub("", str(error)))
    longest = sorted(seconds, key=seconds.__getitem__, reverse=True)[:5]
    told = ", ".join(f"{name} {seconds[name]:.0f} s" for name in longest)
    print(f"{len(seconds)} pages ran, the longest: {told}")


if __name__ == "__main__":
    main()
