"""Which landings each model of Fig. 2.4 draws from, and how large its splits are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.maps.linear.basis import pooled_basis
from hopdata.maps.rare_schedules import MOST_ONE_BY_ONE, Notes, rare_notes

#: Landings that a fit must have beyond its number of coefficients per output.
SPARE_LANDINGS = 2

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Population:
    """Landings that a model draws from: `kind` class, near, all or far; `schedule` of a class."""

    kind: str
    schedule: str
    rows: NDArray[np.int64]

    @property
    def name(self) -> str:
        """Name in notes, and of the random stream that its splits come from."""
        return f"schedule {self.schedule}" if self.kind == "class" else self.kind


def select_populations(
    schedule: NDArray[np.str_], spread: Floats, minimum_class: int
) -> tuple[list[Population], Notes]:
    """Sort the landings into classes, near, all and far, and note the classes left out.

    Near and far are those below and above the median contact spread of all landings.
    """
    populations = []
    rare: dict[str, int] = {}
    for name in sorted({str(item) for item in schedule if item}):
        rows = np.flatnonzero(schedule == name)
        if len(rows) >= minimum_class:
            populations.append(Population("class", name, rows))
        else:
            rare[name] = len(rows)
    notes = rare_notes("specialised models", rare, f"at least {minimum_class} wanted")
    if not populations:
        reason = f"no mode schedule has {minimum_class} touchdowns"
        notes.append({"what": "specialised models", "reason": reason})
    known = np.isfinite(spread)
    median = np.median(spread[known]) if known.any() else np.nan
    populations += [
        Population("near", "", np.flatnonzero(known & (spread < median))),
        Population("all", "", np.arange(len(schedule))),
        Population("far", "", np.flatnonzero(known & (spread > median))),
    ]
    return populations, notes


def split_sizes(population: int, train: int, test: int) -> tuple[int, int]:
    """Return the sizes of the two parts of a split, scaled down where landings are few.

    >>> split_sizes(2860, 120, 41), split_sizes(80, 120, 41)
    ((120, 41), (60, 20))
    """
    total = min(population, train + test)
    fitted = min(round(total * train / (train + test)), total - 1)
    return fitted, total - fitted


def needed_training(x: Floats) -> int:
    """Return the smallest training set that an affine map of these inputs may be fitted to."""
    rank = pooled_basis(x).shape[1] if len(x) else 1
    return rank + SPARE_LANDINGS


def large_enough(
    populations: list[Population], train: int, test: int, needed: int
) -> tuple[list[Population], Notes]:
    """Drop what is too small for an affine map; keep `all` for its mean while it has a split."""
    kept, notes = [], []
    thin: dict[str, int] = {}
    wanted = f"an affine map of these inputs needs {needed}"
    for population in populations:
        size = len(population.rows)
        fitted = split_sizes(size, train, test)[0] if size else 0
        enough = fitted >= needed
        if not enough and population.kind == "class":
            thin[population.name] = fitted
        elif not enough:
            what = "affine model of all touchdowns" if population.kind == "all" else population.name
            notes.append({"what": what, "reason": f"{fitted} touchdowns to fit, {wanted}"})
        if enough or (population.kind == "all" and size >= 2):
            kept.append(population)
    return kept, _thin_notes(thin, wanted) + notes


def _thin_notes(thin: dict[str, int], wanted: str) -> Notes:
    """Note the schedules without an affine map, together where they are many."""
    if len(thin) <= MOST_ONE_BY_ONE:
        return [
            {"what": name, "reason": f"{fitted} touchdowns to fit, {wanted}"}
            for name, fitted in thin.items()
        ]
    sizes = f"{min(thin.values())} to {max(thin.values())} touchdowns each to fit"
    return [{"what": f"affine models of {len(thin)} schedules", "reason": f"{sizes}, {wanted}"}]


def common_split(
    populations: list[Population], train: int, test: int
) -> tuple[tuple[int, int], Notes]:
    """Return the split of the smallest population, which all models share."""
    if not populations:
        return (train, test), []
    smallest = min(populations, key=lambda population: len(population.rows))
    sizes = split_sizes(len(smallest.rows), train, test)
    if sizes == (train, test):
        return sizes, []
    what = (
        f"All models were trained on {sizes[0]} and tested on {sizes[1]} touchdowns instead of "
        f"{train} and {test}"
    )
    return sizes, [{"what": what, "reason": _fewest(smallest)}]


def _fewest(smallest: Population) -> str:
    """Say which landings are so few that they decide the size of the splits."""
    size = len(smallest.rows)
    if smallest.kind == "class":
        return f"the rarest order with a model of its own, {smallest.schedule}, has only {size}"
    which = "" if smallest.kind == "all" else f"{smallest.kind} "
    return f"there are only {size} {which}touchdowns"
