# ruff: noqa: ARG005 (heyoka and the families prescribe the arguments)
"""Flips missed and spurious over the families of guards, with SciPy and heyoka beside.

    python benchmarks/proofs.py --out proofs.csv [--members 300] [--seed 0] [--peers]
        [--path state|jacobian|lanes]

There is one row for each solver, family of `tests/hybrid/families.py` (from where it is
imported) and tolerance: events found, missed and spurious, compared with 200,000
samples of each run's own path (`missed` and `spurious` count crossings and their
returns, `displaced` flips that the path's own error moves); runs that are not proven,
and runs that turned closer to a surface than the tolerance can tell; evaluations of the
guards in each step, of ranges and of numbers together, and the median time of a run
without dense output.

With `--peers`, SciPy's DOP853 and heyoka integrate the same members, with the guard as
an event that changes nothing, and are judged in the same way along their own dense
output. heyoka's expressions have no comparisons, `abs`, `max`, `%` or tables, so
families that need them have a row that says so. Its guards are Taylor series: a run in
which it raises, or does not reach the end, is `failed`.

`--path jacobian` carries the Jacobian, too. `--path lanes` integrates all members of a
family together, in lanes; families that have no lanes have a row that says so. There,
only numbers of flips are known: `missed` are those that the samples of a run's own path
show beyond the flips found, `spurious` those found beyond both the samples and the
driver's flips, and `unlike_driver` counts the members with other flips than by the
driver with the same method; `unlike_not_close` those of them that are close in neither.

Rows that are in the file already are kept, so an interrupted run goes on. All 44
families take hours with 300 members; the file grows by a row at a time.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

from hopdata.arrays import FloatArray, IntArray

TESTS = Path(__file__).resolve().parent.parent / "tests" / "hybrid"
sys.path.insert(0, str(TESTS))

from families import (  # noqa: E402
    ALL,
    GREY,
    SAMPLES,
    guard_of,
    judged,
    run,
    sampler,
    system_of,
)

from hopdata.hybrid import BatchSolution, solve_batch  # noqa: E402

RTOLS = (1e-3, 1e-6, 1e-9, 1e-12)
SMALLEST_RTOL = 2.3e-14  # of SciPy
OURS = "hopdata"
PATHS = {"state": OURS, "jacobian": "hopdata, jacobian", "lanes": "hopdata, lanes"}
AT_ONCE = 16  # members whose paths are sampled together


def time_us(name: str, rtol: float, members: int, key: list[int]) -> float:
    """Return the median CPU time of a run; each is the second of its member."""
    times = []
    for member in range(members):
        run(name, rtol, np.random.default_rng([*key, member]))
        start = time.process_time()
        run(name, rtol, np.random.default_rng([*key, member]))
        times.append(time.process_time() - start)
    return 1e6 * float(np.median(times))


def key_of(name: str, seed: int) -> list[int]:
    """Return what the members of a family are drawn from, but for their number."""
    return [seed, *map(ord, name)]


def row_of(
    name: str, rtol: float, members: int, seed: int, jacobian: bool
) -> dict[str, object]:
    """Return our row of a family, in single runs."""
    key = key_of(name, seed)
    verdicts = [
        judged(name, rtol, np.random.default_rng([*key, member]), jacobian=jacobian)
        for member in range(members)
    ]
    solutions = [one.solution for one in verdicts]
    looks = [one.n_guard_evaluations for one in solutions]
    steps = [one.n_steps for one in solutions]
    return {
        "solver": PATHS["jacobian" if jacobian else "state"],
        "family": name,
        "rtol": rtol,
        "members": members,
        "seed": seed,
        "events": sum(one.events for one in verdicts),
        "missed": sum(one.missed for one in verdicts),
        "spurious": sum(one.spurious for one in verdicts),
        "displaced": sum(one.displaced for one in verdicts),
        "failed": sum(not one.success for one in solutions),
        "unproven": sum(not one.proven for one in solutions),
        "close": sum(one.n_close > 0 for one in solutions),
        "evaluations_per_step": sum(looks) / sum(steps),
        "time_us": time_us(name, rtol, min(members, 20), key),
    }


def sampled_flips(name: str, found: BatchSolution, params: FloatArray) -> IntArray:
    """Return how often the guard changes its sign along the samples of each path."""
    flips = []
    for states, own in zip(found.y, params, strict=True):
        h = np.empty(len(found.t))
        sampler(name)(found.t, np.ascontiguousarray(states), own, h)
        signs = np.sign(h[abs(h) > GREY * abs(h).max()])
        flips.append(np.count_nonzero(np.diff(signs)))
    return np.array(flips)


def lanes_row(name: str, rtol: float, members: int, seed: int) -> dict[str, object]:
    """Return our row of a family in lanes, with the median of their ends as the end."""
    key = key_of(name, seed)
    drawn = [
        ALL[name].draw(np.random.default_rng([*key, member]))
        for member in range(members)
    ]
    starts, params, ends = (np.array(one) for one in zip(*drawn, strict=True))
    span = (0.0, float(np.median(ends)))
    asked = {"rtol": rtol, "atol": 1e-3 * rtol, "workers": 1, "method": "dop853"}
    row = {
        "solver": PATHS["lanes"], "family": name, "rtol": rtol, "members": members,
        "seed": seed,
    }  # fmt: skip
    begin = time.process_time()
    here = solve_batch(
        system_of(name), span, starts, params=params, lanes=True, **asked
    )
    seconds = time.process_time() - begin
    if not here.lanes.any():
        return row | {"note": here.lanes_reason or "all are left to the driver"}
    plain = solve_batch(system_of(name), span, starts, params=params, **asked)
    flips = []
    times = np.linspace(*span, SAMPLES)
    for first in range(0, members, AT_ONCE):
        some = slice(first, first + AT_ONCE)
        sampled = solve_batch(
            system_of(name), span, starts[some], params=params[some], t_eval=times,
            lanes=True, **asked,
        )  # fmt: skip
        flips.append(sampled_flips(name, sampled, params[some]))
    seen = np.concatenate(flips)
    known = np.maximum(seen, plain.n_events)
    unlike = here.n_events != plain.n_events
    close = (here.n_close > 0) | (plain.n_close > 0)
    return row | {
        "events": here.n_events.sum(),
        "missed": np.maximum(seen - here.n_events, 0).sum(),
        "spurious": np.maximum(here.n_events - known, 0)[~close].sum(),
        "failed": np.count_nonzero(here.status < 0),
        "unproven": np.count_nonzero(~here.proven),
        "close": np.count_nonzero(here.n_close),
        "in_lanes": here.lanes.mean(),
        "unlike_driver": np.count_nonzero(unlike),
        "unlike_not_close": np.count_nonzero(unlike & ~close),
        "time_us": 1e6 * seconds / members,
    }


# Peers: their events, and the times and states of their own dense output.


@dataclass(frozen=True)
class Seen:
    """What a peer has found of a member."""

    events: FloatArray
    path: Callable[[FloatArray], FloatArray]
    seconds: float


Peer = Callable[[list[float], list[float], float], Seen]


def by_scipy(name: str, rtol: float) -> Peer:
    """Return a function that solves a member with `solve_ivp`."""
    ivp: Any = solve_ivp
    family, guard = ALL[name], guard_of(name)
    n_states = family.n_states
    rates: Any = family.field
    if not family.is_plain:
        rates = rates.function
    takes_params = family.is_plain and rates.__code__.co_argcount > 2
    no_mode, nothing = np.zeros(0, dtype=np.int64), np.zeros(n_states)

    def solved(start: list[float], params: list[float], end: float) -> Seen:
        numbers = np.array(params)

        def slope(t: float, y: FloatArray) -> FloatArray:
            if takes_params:
                return np.atleast_1d(rates(t, y, numbers))
            if family.is_plain:
                return np.atleast_1d(rates(t, y))
            dy = np.empty(n_states)
            rates(t, y, no_mode, numbers, dy)
            return dy

        def height(t: float, y: FloatArray) -> float:
            return guard(t, y, nothing, numbers)[0]

        def run(dense: bool) -> Any:
            return ivp(
                slope, (0.0, end), start, method="DOP853", atol=1e-3 * rtol,
                rtol=max(rtol, SMALLEST_RTOL), events=height, dense_output=dense,
            )  # fmt: skip

        begin = time.process_time()
        run(False)
        seconds = time.process_time() - begin
        found = run(True)
        return Seen(found.t_events[0], found.sol, seconds)

    return solved


def heyoka_guards(hy: Any) -> dict[str, Callable[[Any, Any], Any]]:
    """Return the guards that are expressions: functions of the state and parameters."""
    t, p = hy.time, [hy.par[i] for i in range(5)]

    def cosines(x: Any) -> Any:
        return (
            0.2 * hy.cos(3.0 * x)
            + 0.1 * hy.cos(p[2] + 11.0 * x)
            + 0.1 * hy.cos(23.0 * x)
        )

    def bump(y: Any) -> Any:
        away = (y[0] - p[1]) / p[4]
        return p[3] - hy.exp(-(away * away))

    return {
        "two sines": lambda y: hy.sin(p[0] * t) + p[1] * hy.sin(p[2] * t + p[3]) + p[4],
        "cos^400": lambda y: p[2] - hy.cos(p[0] * t + p[1]) ** 400.0,
        "bump 0.1": bump,
        "bump 0.02": bump,
        "sine of state": lambda y: hy.sin(p[0] * y[0] + p[1]),
        "near roots": lambda y: (y[0] - p[0]) * (y[0] - p[0] - p[1]),
        "plate": lambda y: y[1] + hy.sin(y[2]) / hy.cos(y[2]) * (p[0] - y[0]),
        "foot": lambda y: 0.5 - y[0] - p[0] * y[1],
        "growth": lambda y: hy.sin(p[0] * y[0]),
        "terrain": lambda y: y[1] - cosines(y[0]),
        "graze": lambda y: (y[0] - p[0]) ** 2.0 + (y[1] - p[1]) ** 2.0 - p[2] * p[2],
        "constant 0.01": lambda y: y[0] * y[0] + y[1] * y[1] - p[0],
        "constant 0.0001": lambda y: y[0] * y[0] + y[1] * y[1] - p[0],
        "constant 0": lambda y: y[0] * y[0] + y[1] * y[1] - p[0],
        "double root": lambda y: (y[0] - p[0]) ** 2.0,
        "flat root": lambda y: (y[0] - p[0]) ** 5.0,
    }  # fmt: skip


def heyoka_rates(hy: Any, y: Any) -> dict[str, list[Any]]:
    """Return the fields of the families as expressions, by their functions' names."""
    zero = 0.0 * hy.par[0]
    return {
        "flight": [*y[2:4], zero, zero - 9.81],
        "orbit": [-y[1], y[0]],
        "clock": [zero + 1.0],
        "tumbling": [*y[3:6], zero, zero - 9.81, zero],
        "rocking": [*y[2:4], 60.0 * (0.5 - y[0]), -25.0 * y[1]],
        "growth": [y[0]],
    }


def by_heyoka(name: str, rtol: float) -> Peer:
    """Return a function that solves a member with heyoka."""
    import heyoka as hy

    hy.set_logger_level_error()  # otherwise each flat root logs a warning
    family = ALL[name]
    y = hy.make_vars(*[f"y{i}" for i in range(6)])
    function = getattr(family.field, "function", family.field)
    rates = heyoka_rates(hy, y)[function.__name__]
    events: list[float] = []
    event = hy.nt_event(heyoka_guards(hy)[name](y), lambda _, t, sign: events.append(t))
    equations = list(zip(y[: family.n_states], rates, strict=True))
    integrator = hy.taylor_adaptive(
        equations, [0.0] * family.n_states, tol=rtol, nt_events=[event]
    )

    def solved(start: list[float], params: list[float], end: float) -> Seen:
        used = len(integrator.pars)
        integrator.pars[:] = np.array(params, dtype=float)[:used]

        def run(dense: bool) -> Any:
            events.clear()
            integrator.time, integrator.state[:] = 0.0, start
            integrator.reset_cooldowns()
            return integrator.propagate_until(end, c_output=dense)

        begin = time.process_time()
        run(False)
        seconds = time.process_time() - begin
        result = run(True)
        if result[0] != hy.taylor_outcome.time_limit:
            raise RuntimeError(str(result[0]))
        output = result[4]
        return Seen(np.array(events), lambda t: output(t).T.copy(), seconds)

    return solved


PEERS = {"SciPy": by_scipy, "heyoka": by_heyoka}


def compared(name: str, member: Any, seen: Seen) -> tuple[int, int, int]:
    """Return missed, spurious and displaced flips, by `families.judged`'s rule."""
    _, params, end = member
    times = np.sort(seen.events)
    middles = 0.5 * (times[1:] + times[:-1])
    looks = np.sort(np.concatenate([np.linspace(0.0, end, SAMPLES), middles]))
    h = np.empty(len(looks))
    states = np.ascontiguousarray(seen.path(looks))
    sampler(name)(looks, states, np.array(params), h)
    number = np.searchsorted(times, looks, side="right")
    # A peer tells no side, but it begins on the right one.
    grey = GREY * abs(h).max()
    begin = np.argmax(abs(h) > grey)
    parity = np.where(number % 2 == number[begin] % 2, 1.0, -1.0)
    lock = parity * np.sign(h[begin])
    wrong = (np.sign(h) != lock) & (abs(h) > grey)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wrong, [False]])))
    missed, spurious, displaced = 0, 0, 0
    padded = np.concatenate([[0], number, [len(times)]])
    for first, after in edges.reshape(-1, 2):
        flips_before = padded[first + 1] != padded[first]
        flips_after = padded[after + 1] != padded[after]
        if flips_before != flips_after:
            displaced += 1
        elif flips_before:
            spurious += 2
        elif after == len(looks):  # no return before the end
            missed += 1
        else:
            missed += 2
    return missed, spurious, displaced


def peer_row(
    solver: str, name: str, rtol: float, members: int, seed: int
) -> dict[str, object]:
    """Return the row of a peer, which says so if it has none."""
    row: dict[str, object] = {
        "solver": solver, "family": name, "rtol": rtol, "members": members, "seed": seed,
    }  # fmt: skip
    try:
        solved = PEERS[solver](name, rtol)
    except ImportError as error:
        return row | {"note": f"absent: {error}"}
    except KeyError:
        return row | {"note": "the guard is no expression"}
    events, failed, seconds = 0, 0, []
    total = np.zeros(3, dtype=int)
    for number in range(members):
        member = ALL[name].draw(np.random.default_rng([*key_of(name, seed), number]))
        try:
            seen = solved(*member)
        except (RuntimeError, ValueError):  # its search for a root failed
            failed += 1
            continue
        events += len(seen.events)
        total += compared(name, member, seen)
        seconds.append(seen.seconds)
    missed, spurious, displaced = map(int, total)
    time_of_run = np.nan
    if seconds:
        time_of_run = 1e6 * float(np.median(seconds))
    return row | {
        "events": events, "missed": missed, "spurious": spurious,
        "displaced": displaced, "failed": failed, "time_us": time_of_run,
    }  # fmt: skip


COLUMNS = (
    "solver", "family", "rtol", "members", "seed", "events", "missed", "spurious",
    "displaced", "failed", "unproven", "close", "evaluations_per_step", "time_us",
    "in_lanes", "unlike_driver", "unlike_not_close", "note",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--members", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--families", nargs="*", default=list(ALL))
    parser.add_argument("--rtols", nargs="*", type=float, default=RTOLS)
    parser.add_argument("--path", choices=PATHS, default="state")
    parser.add_argument("--peers", action="store_true", help="SciPy and heyoka, too")
    arguments = parser.parse_args()
    rows: list[dict[str, Any]] = []
    if arguments.out.exists():
        rows = pd.read_csv(arguments.out).to_dict("records")
    named = ("solver", "family", "rtol", "members", "seed")
    done = {tuple(row[name] for name in named) for row in rows}
    ours = PATHS[arguments.path]
    solvers: tuple[str, ...] = (ours,)
    if arguments.peers:
        solvers = (ours, *PEERS)
    size = arguments.members, arguments.seed
    for name in arguments.families:
        for rtol in arguments.rtols:
            for solver in solvers:
                if (solver, name, rtol, *size) in done:
                    continue
                if solver == PATHS["lanes"]:
                    rows.append(lanes_row(name, rtol, *size))
                elif solver == ours:
                    rows.append(row_of(name, rtol, *size, arguments.path == "jacobian"))
                else:
                    rows.append(peer_row(solver, name, rtol, *size))
                print(rows[-1], flush=True)
                table = pd.DataFrame(rows, columns=COLUMNS)
                partial = arguments.out.with_suffix(".partial")
                table.to_csv(partial, index=False)
                partial.replace(arguments.out)  # an interrupt leaves the last table


if __name__ == "__main__":
    main()
