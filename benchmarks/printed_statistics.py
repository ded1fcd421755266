"""The dissertation's comparison of schedules, and one of maps, on pairs held in memory."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from observed_landings import SeenLandings

from hopdata.landings.schedules import schedule_names
from hopdata.landings.states.assemble import HomeFrames
from hopdata.maps.affine import fit_affine
from hopdata.maps.coordinates import rigid_states, section_coordinates, split_states
from hopdata.maps.subspaces.constraint import bootstrap_subspaces
from hopdata.maps.subspaces.distances import measure_distances
from hopdata.maps.units import choose_units
from hopdata.rigid import body_shape

BOOTSTRAPS, PAIRS, HALVINGS = 100, 300, 5


def printed_overlap(seen: SeenLandings, seed: int) -> tuple[float, float, float]:
    """Return mean in-class and cross-class arc lengths at k = 17, rad, and the AUC between them."""
    x, y = _home_pairs(seen)
    units = choose_units(x, y)
    factor = np.repeat([1.0 / units.length_unit_m, units.time_unit_s / units.length_unit_m], 9)
    study = bootstrap_subspaces(
        x * factor, y * factor, schedule_names(seen.instants), seed=seed, bootstraps=BOOTSTRAPS
    )
    found = measure_distances(study.bases, study.shape, seed=seed, pairs=PAIRS).summary
    rows = found.set_index("kind")
    return (
        float(rows.loc["in_class", "mean"]),
        float(rows.loc["cross_class", "mean"]),
        float(rows.loc["cross_class", "auc_against_in_class"]),
    )


def operator_ratio(seen: SeenLandings, rng: np.random.Generator) -> float:
    """Return how far maps of schedules lie apart over how far halves of one schedule do.

    Largest singular value of differences between affine maps in whitened rigid-body coordinates,
    landings nearer to the simultaneous contact than the median; two times two halves each.
    """
    shape = body_shape(split_states(seen.before)[0])
    x, y = section_coordinates(rigid_states(seen.before, shape), rigid_states(seen.after, shape))
    spread = seen.instants.std(axis=1)
    near = spread < np.median(spread)
    x, y = (part[near] / part[near].std(axis=0) for part in (x, y))
    names = np.array(schedule_names(seen.instants[near]))
    classes = [np.flatnonzero(names == name) for name in sorted(set(names.tolist()) - {""})]
    classes = [rows for rows in classes if len(rows) >= 40]
    within, across = [], []
    for _ in range(HALVINGS):
        mixed = [rng.permutation(rows) for rows in classes]
        maps = [[fit_affine(x[r[k::2]], y[r[k::2]]).coefficients for k in (0, 1)] for r in mixed]
        within += [np.linalg.norm(a - b, 2) for a, b in maps]
        across += [np.linalg.norm(a[0] - b[1], 2) for a, b in combinations(maps, 2)]
    return float(np.mean(across) / np.mean(within)) if across else float("nan")


def _home_pairs(seen: SeenLandings) -> tuple[np.ndarray, np.ndarray]:
    """Pairs in home frames; means over the touchdown are those of its two ends."""
    before, after = split_states(seen.before), split_states(seen.after)
    middle = 0.5 * (before[0] + after[0])[:, :, :2]
    origin = middle.mean(axis=1)
    ray = middle[:, 0] - origin
    home = HomeFrames(origin, ray / np.linalg.norm(ray, axis=1, keepdims=True))
    x, y = (
        np.concatenate([home.points(position), home.vectors(velocity)], axis=1)
        for position, velocity in (before, after)
    )
    return x.reshape(len(x), -1), y.reshape(len(y), -1)
