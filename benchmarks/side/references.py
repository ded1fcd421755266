"""The ends of the systems that are not ours, with thirty digits.

    python benchmarks/side/references.py --out benchmarks/side/references.csv

mpmath's Taylor series integrates from event to event with 30 digits. heyoka does the
same with the 80 bits of a long double and its own search for events; `apart` is the
largest difference of the two final states. Neither shares code with ours.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import mpmath
import pandas as pd
from mpmath import mp, mpf

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from side import Scene, scenes

DIGITS = 30
LOOKS = 4000  # at the guards, evenly over the whole time
AT_SURFACE = mpf(10) ** -24


def first_event(
    path: Any, guards: Any, begin: Any, end: Any, apart: Any
) -> tuple[Any, int] | None:
    """Return time and number of the first guard that falls through zero."""
    before, seen = begin, guards(begin, path(begin))
    while before < end:
        now = min(before + apart, end)
        values = guards(now, path(now))
        fallen = [
            (root_of(path, guards, k, before, now), k)
            for k in range(len(values))
            if values[k] <= 0 and seen[k] > AT_SURFACE
        ]
        if fallen:
            return min(fallen)
        before, seen = now, values
    return None


def root_of(path: Any, guards: Any, k: int, low: Any, high: Any) -> Any:
    """Return where guard k falls through zero, to the last digits."""
    return mpmath.findroot(
        lambda t: guards(t, path(t))[k], (low, high), solver="anderson",
        tol=mpf(10) ** -50, maxsteps=200,
    )  # fmt: skip


def by_series(scene: Scene) -> tuple[list[Any], int]:
    """Return the final state, and the number of events, with thirty digits."""
    mp.dps = DIGITS
    rates, heights, after = (
        of(mpmath) for of in (scene.rates, scene.heights, scene.after)
    )
    now, end = mpf(scene.t_span[0]), mpf(scene.t_span[1])
    y, mode = [mpf(one) for one in scene.y0], tuple(mpf(one) for one in scene.mode)
    count, apart = 0, (end - now) / LOOKS
    while True:
        here = mode

        def slope(t: Any, y: Any, here: Any = here) -> list[Any]:
            return list(rates(t, y, here))

        def guards(t: Any, y: Any, here: Any = here) -> Any:
            return heights(t, y, here)

        path = mpmath.odefun(slope, now, y)
        found = first_event(path, guards, now, end, apart)
        if found is None:
            return list(path(end)), count
        now, k = found
        y, mode = after(now, list(path(now)), mode, k)
        y, count = [mpf(one) for one in y], count + 1


def row_of(scene: Scene) -> list[dict[str, object]]:
    """Return one row for each state of a system."""
    from side.heyoka_side import in_long_double

    end, count = by_series(scene)
    other, other_count = in_long_double(scene)
    assert count == other_count, (scene.name, count, other_count)
    apart = max(abs(a - mpf(str(b))) for a, b in zip(end, other, strict=True))
    return [
        {"system": scene.name, "events": count, "state": i, "value": mpmath.nstr(value, 25),
         "apart": float(apart)}
        for i, value in enumerate(end)
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--systems", nargs="*", help="only these")
    arguments = parser.parse_args()
    rows: list[dict[str, object]] = []
    for scene in scenes():
        if arguments.systems and scene.name not in arguments.systems:
            continue
        rows += row_of(scene)
        print(rows[-1], flush=True)
        pd.DataFrame(rows).to_csv(arguments.out, index=False)


if __name__ == "__main__":
    main()
