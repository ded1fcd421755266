"""The stress suite: events missed and spurious, errors and statuses, with SciPy beside it.

    python benchmarks/stress.py --out stress.csv

There is one row for each case of `tests/hybrid/stress` (whose modules are imported from
there), the long run of `--hops` hops at a tight and at the tightest tolerance, and
blocks of 100 of the `--systems` random systems of each kind (`back`: from the end to
the start). `missed` and `spurious` count events relative to the exact answer.
`error_max` is the largest deviation of the final state in the case's own units, and
`error_over_tolerance` the same in units of the case's tolerance. `status` and
`right_status` say how the integration ended and how it should have. The rows of `scipy`
show one call of `solve_ivp` (RK45, same tolerances), which has no locks, so its field
sees the sign of h. There, `right` applies the same criteria as to our solver; read its
`missed`, `spurious` and `error_max` instead. The rows of `quick` are `--systems` / 5
random members of each family of guards that bend or move quickly, at each of four
tolerances, with all methods in turn. SciPy's DOP853 and heyoka (if the guard is an
expression) integrate the same systems, which no event changes, and only watch for
events. `--seed` draws other systems in every random family; the peers run only with the
usual ones.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

TESTS = Path(__file__).resolve().parent.parent / "tests" / "hybrid"
sys.path[:0] = [str(TESTS), str(TESTS / "stress")]

from stress_case import Case, Verdict, compare, judge, matched, turned_back  # noqa: E402
from stress_edges import edge_cases  # noqa: E402
from stress_gaps import gap_cases  # noqa: E402
from stress_mass import energy, long_case, mass_cases  # noqa: E402
from stress_quick import (  # noqa: E402
    BUMP,
    FAMILIES,
    FIXED,
    PLANE,
    POWER,
    PRODUCT,
    RTOLS,
    SINE,
    SURFACE,
    WIDTH,
    quick,
    quick_member,
    table_member,
)
from stress_quick import METHODS as QUICK_METHODS  # noqa: E402
from stress_random import random_case  # noqa: E402
from stress_roots import root_cases  # noqa: E402
from stress_swings import METHODS as SWING_METHODS  # noqa: E402
from stress_swings import swing_cases  # noqa: E402

from hopdata.hybrid import solve  # noqa: E402
from hopdata.hybrid.arguments import SMALLEST_RTOL  # noqa: E402

BLOCK = 100
KINKED = (
    "abs",
    "max",
    "table",
    "after an event",
)  # families without expressions in heyoka
Row = dict[str, object]


def row_of(solver: str, case: str, parameter: str, verdict: Verdict) -> Row:
    return {
        "solver": solver, "case": case, "parameter": parameter,
        "events_expected": verdict.expected, "missed": verdict.missed,
        "spurious": verdict.spurious, "error_max": verdict.error_max,
        "error_over_tolerance": verdict.error, "status": verdict.status,
        "right_status": verdict.right_status, "right": verdict.right, "time_us": verdict.time_us,
    }  # fmt: skip


def single_rows(cases: list[Case]) -> Iterator[Row]:
    """Yield one row per case; the second call is timed."""
    for case in cases:
        judge(case)
        yield row_of("hopdata", case.name, case.parameter, judge(case))


def summed_row(name: str, parameter: str, cases: list[Case]) -> Row:
    """Return sums and worst values over many cases; the time is their mean."""
    judge(cases[0])
    verdicts = [judge(case) for case in cases]
    wrong = sum(not verdict.right for verdict in verdicts)
    total = Verdict(
        expected=sum(v.expected for v in verdicts), missed=sum(v.missed for v in verdicts),
        spurious=sum(v.spurious for v in verdicts), error=max(v.error for v in verdicts),
        error_max=max(v.error_max for v in verdicts), status=min(v.status for v in verdicts),
        right_status=all(v.right_status for v in verdicts),
        right_mode=all(v.right_mode for v in verdicts),
        time_us=float(np.mean([v.time_us for v in verdicts])),
    )  # fmt: skip
    return row_of("hopdata", name, f"{parameter}, {wrong} wrong", total)


def block_rows(first: int, count: int, *, affine: bool) -> Iterator[Row]:
    """Yield the rows of a block of random event-selected systems, integrated forward and back."""
    cases = [random_case(seed, affine=affine) for seed in range(first, first + count)]
    seeds = f"seeds {first} to {first + count - 1}"
    yield summed_row(cases[0].name, seeds, cases)
    yield summed_row(
        f"{cases[0].name} back", seeds, [turned_back(case) for case in cases]
    )


def swing_rows(count: int, seed: int) -> Iterator[Row]:
    """Yield a row for each method that integrates swings near their guard."""
    cases = swing_cases(count, 11 + seed)
    for method in SWING_METHODS:
        chosen = [case for case in cases if case.options["method"] == method]
        yield summed_row("swing", f"{len(chosen)} systems, {method}", chosen)


def quick_rows(count: int, seed: int) -> Iterator[Row]:
    """Yield rows of the families of quick guards: ours and, for seed 0, SciPy's and heyoka's."""
    for family in (*FAMILIES, "shaking table"):
        for number, rtol in enumerate(RTOLS):
            rng = np.random.default_rng([number + len(RTOLS) * seed, *map(ord, family)])
            if family == "shaking table":
                cases = [table_member(rng, rtol) for _ in range(count)]
                yield summed_row("quick", f"{family}, {rtol:g}", cases)
                continue
            cases = [quick_member(family, rng, rtol) for _ in range(count)]
            methods = [
                {"method": method}
                for _, method in zip(cases, cycle(QUICK_METHODS), strict=False)
            ]
            ours = [
                replace(
                    case,
                    system=quick(m["method"] == "taylor"),
                    options=case.options | m,
                )
                for case, m in zip(cases, methods, strict=True)
            ]
            yield summed_row("quick", f"{family}, {rtol:g}", ours)
            if family == "after an event":  # peers without locks cannot represent it
                continue
            yield summed_row(
                "quick back", f"{family}, {rtol:g}", [turned_back(c) for c in ours]
            )
            if seed > 0:
                continue
            yield peer_row(
                "scipy", f"{family}, {rtol:g}", [watched_by_scipy(c) for c in cases]
            )
            if family not in KINKED:
                watch = heyoka_watcher(family, rtol)
                yield peer_row(
                    "heyoka", f"{family}, {rtol:g}", [watch(case) for case in cases]
                )


def counted(case: Case, found: list[tuple[float, int]], time_us: float) -> Verdict:
    """Compare the events that a peer saw with the true ones, within a thousandth of the span."""
    expected = case.answers[0].events
    tolerance = max(1e-3 * case.t_span[1], case.answers[0].time_tolerance)
    pairs = 0
    for k in range(2):
        seen = sorted(t for t, guard in found if guard == k)
        pairs += matched(seen, [t for t, guard, _ in expected if guard == k], tolerance)
    missed, spurious = len(expected) - pairs, len(found) - pairs
    return Verdict(
        len(expected), missed, spurious, np.nan, np.nan, 0, True, True, time_us
    )


def peer_row(solver: str, parameter: str, verdicts: list[Verdict]) -> Row:
    """Return the sums of the events that a peer saw."""
    wrong = sum(v.missed + v.spurious > 0 for v in verdicts)
    total = Verdict(
        sum(v.expected for v in verdicts), sum(v.missed for v in verdicts),
        sum(v.spurious for v in verdicts), np.nan, np.nan, 0, True, wrong == 0,
        float(np.median([v.time_us for v in verdicts])),
    )  # fmt: skip
    return row_of(solver, "quick", f"{parameter}, {wrong} wrong", total) | {
        "right": wrong == 0
    }


def watched_by_scipy(case: Case) -> Verdict:
    """Return the crossings that `solve_ivp` sees with DOP853 and its event functions."""
    params, mode = np.asarray(case.options["params"]), np.array([-1, -1, 0])
    system, h, rates, nothing = case.system, np.empty(2), np.empty(2), np.zeros(5)
    guards, slope_of = system.guards, system.field
    assert guards is not None

    def height(t: float, y: np.ndarray, k: int) -> float:
        guards(t, y, nothing, mode, params, h, rates)
        return float(h[k])

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        dy = np.empty(5)
        slope_of(t, y, mode, params, dy)
        return dy

    start, found = time.perf_counter(), []
    try:
        end = solve_ivp(
            slope, case.t_span, np.asarray(case.y0), method="DOP853", rtol=case.options["rtol"],
            atol=case.options["atol"], events=[lambda t, y, k=k: height(t, y, k) for k in range(2)],
        )  # fmt: skip
        found = [(t, k) for k in range(2) for t in end.t_events[k]]
    except RuntimeError:  # its search for a flat root fails
        pass
    return counted(case, found, 1e6 * (time.perf_counter() - start))


def heyoka_watcher(family: str, rtol: float) -> Callable[[Case], Verdict]:
    """Return a function that integrates a member with heyoka; guards are non-terminal events."""
    import heyoka as hy

    hy.set_logger_level_error()  # otherwise each flat root logs a warning
    x, v, c, s = hy.make_vars("x", "v", "c", "s")
    fall, growth, turn = (hy.par[i] for i in range(FIXED))
    kinds = [int(row[0]) for row in first_numbers(family)]
    u, found = x + c, []

    def height(k: int) -> Any:
        a, b, p, d = (hy.par[FIXED + WIDTH * k + i] for i in range(1, 5))
        power = int(first_numbers(family)[k][3]) if kinds[k] == POWER else 1
        return {
            SURFACE: lambda: u - a - b * hy.sin(p * hy.time + d),
            SINE: lambda: hy.sin(b * u + p) - d,
            BUMP: lambda: a * hy.exp(-0.5 * ((u - p) / b) ** 2) - d,
            PRODUCT: lambda: (u - a) * (v - b) * p,
            POWER: lambda: b * (u - a) ** power,
            PLANE: lambda: u - a,
        }[kinds[k]]()

    def note(k: int) -> Callable[..., None]:
        return lambda *seen: found.append((seen[1], k))  # integrator, instant, sign

    rates = [(x, v), (v, -fall), (c, growth * c - turn * s), (s, turn * c + growth * s)]
    integrator = hy.taylor_adaptive(
        rates,
        [0.0] * 4,
        tol=rtol,
        nt_events=[hy.nt_event(height(k), note(k)) for k in range(2)],
    )

    def watch(case: Case) -> Verdict:
        found.clear()
        integrator.time, integrator.state[:] = 0.0, np.asarray(case.y0)[:4]
        integrator.pars[:] = np.asarray(case.options["params"])[: len(integrator.pars)]
        start = time.perf_counter()
        integrator.propagate_until(case.t_span[1])
        return counted(case, list(found), 1e6 * (time.perf_counter() - start))

    return watch


def first_numbers(family: str) -> list[Any]:
    """Return the numbers of both guards of one member; their kinds are the same for all members."""
    return [draw(np.random.default_rng(0)) for draw in FAMILIES[family][:2]]


def long_row(hops: int, rtol: float) -> Row:
    """Return the row of the long run, whose name includes the relative drift of the energy."""
    case = long_case(hops, rtol=rtol)
    case = replace(case, options={**case.options, "t_eval": [case.t_span[1]]})
    start = time.perf_counter()
    solution = solve(case.system, case.t_span, case.y0, **case.options)
    elapsed = 1e6 * (time.perf_counter() - start)
    stiffness = case.options["params"][1]
    drift = (
        energy(stiffness, solution.y_end) / energy(stiffness, np.array(case.y0)) - 1.0
    )
    verdict = replace(compare(solution, case.answers[0]), time_us=elapsed)
    return row_of(
        "hopdata", case.name, f"{case.parameter}, energy {drift:+.2g}", verdict
    )


def by_scipy(case: Case) -> Verdict:
    """Solve a case by one call of `solve_ivp`, without locks: the field uses the sign of h."""
    system, params = case.system, np.asarray(case.options["params"], dtype=float)
    n_guards = system.n_guards
    assert system.guards is not None
    guards = system.guards

    def heights(t: float, y: np.ndarray) -> np.ndarray:
        h, rates = np.empty(n_guards), np.empty(n_guards)
        guards(t, y, np.zeros(len(y)), np.zeros(n_guards, dtype=int), params, h, rates)
        return h

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        dy = np.empty_like(y)
        system.field(t, y, np.where(heights(t, y) > 0, 1, -1), params, dy)
        return dy

    start = time.perf_counter()
    end = solve_ivp(
        slope, case.t_span, np.array(case.y0, dtype=float), method="RK45",
        rtol=max(case.options.get("rtol", 1e-9), 1e-12), atol=case.options.get("atol", 1e-12),
        events=[lambda t, y, k=k: heights(t, y)[k] for k in range(n_guards)],
    )  # fmt: skip
    elapsed = 1e6 * (time.perf_counter() - start)
    answer = case.answers[0]
    # Its event times are accurate only to its tolerance, so a thousandth of the span is
    # allowed.
    tolerance = 1e-3 * (case.t_span[1] - case.t_span[0])
    pairs = sum(
        matched(sorted(times), [t for t, g, _ in answer.events if g == k], tolerance)
        for k, times in enumerate(end.t_events)
    )
    found = sum(len(times) for times in end.t_events)
    off = np.abs(end.y[:, -1] - answer.y_end)
    error = float((off / np.maximum(answer.state_tolerance, 1e-300)).max())
    return Verdict(
        len(answer.events), len(answer.events) - pairs, found - pairs, error, float(off.max()),
        end.status, end.status == answer.status, True, elapsed,
    )  # fmt: skip


def scipy_rows(cases: list[Case]) -> Iterator[Row]:
    """Yield scipy's results for a few of the cases."""
    shown = {
        "contact_gap": (
            "0.001 mixed at 1",
            "1e-12 mixed at 1",
            "1e-16 mixed at 1",
            "0 mixed at 1",
        ),
        "grazing": ("-0.001, 2 m/s", "-1e-06, 2 m/s", "-1e-10, 2 m/s"),
        "on_guard_at_start": ("rate 1, bend -2, h 1", "rate -1, bend -2, h 1"),
        "recrossing": ("1e-12 turned 0",),
        "rotor": ("cos 20 angle, rate 1, rtol 1e-09",),
    }
    for case in cases:
        if case.parameter in shown.get(case.name, ()):
            yield row_of("scipy", case.name, case.parameter, by_scipy(case))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument(
        "--hops", type=int, default=100_000, help="hops of the long run"
    )
    parser.add_argument(
        "--systems", type=int, default=1000, help="random systems of each kind"
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="seed of the random systems"
    )
    arguments = parser.parse_args()
    seed, drawn_before = arguments.seed, arguments.seed * arguments.systems
    cases = [*gap_cases(), *root_cases(), *edge_cases(), *mass_cases()]
    rows = list(single_rows(cases))
    rows.extend(long_row(arguments.hops, rtol) for rtol in (1e-13, SMALLEST_RTOL))
    for affine in (False, True):
        for first in range(0, arguments.systems, BLOCK):
            count = min(BLOCK, arguments.systems - first)
            rows.extend(block_rows(drawn_before + first, count, affine=affine))
    rows.extend(swing_rows(arguments.systems, seed))
    rows.extend(quick_rows(max(1, arguments.systems // 5), seed))
    rows.extend(scipy_rows(cases))
    table = pd.DataFrame(rows)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(arguments.out, index=False)
    for solver, part in table.groupby("solver"):
        print(
            f"{solver:8} {len(part):4} rows, {part['events_expected'].sum()} events expected, "
            f"{part['missed'].sum()} missed, {part['spurious'].sum()} spurious, "
            f"{(~part['right']).sum()} rows wrong"
        )
    wrong = table[(table["solver"] == "hopdata") & ~table["right"]]
    if len(wrong) > 0:
        print(wrong.drop(columns=["solver", "right"]).to_string(index=False))


if __name__ == "__main__":
    main()
