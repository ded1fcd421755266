"""Constraint subspaces and the distances between them (Secs. 2.2.4, 2.3; Fig. 2.5).

The sample is studied twice, by the methods as printed and by ours, and its control
once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.dissertation import small_studies
from hopdata.dissertation.rows import Agreement, Made, Row, over_seeds
from hopdata.dissertation.sample import CONTROL, study_of, truth_of
from hopdata.maps.distances import (
    DISTANCES,
    noise_sensitivity,
    noised_identities,
    snr_readings,
)
from hopdata.maps.draws import named_generator
from hopdata.maps.subspaces import (
    KINDS,
    DistanceStudy,
    arc_length,
    bootstrap_subspaces,
    measure_distances,
    orthonormalised,
    principal_angles,
    principal_subspaces,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hopdata.walk import Study

# What the dissertation prints: dimensions of the pairs of states and of a subspace, and
# landings of a subspace. The two means, rad, follow from it: of 1000 pairs of noised
# identities, and of uniform subspaces.
SHAPE = (34, 17)
NOISED_MEAN = 2.268
RANDOM_MEAN = 3.7605
SAMPLES = 30

#: Pairs of subspaces of each schedule, and of each two; a study takes 1000.
#: Unit: 1. Origin: chosen.
PAIRS = 300
#: Quantiles by which a distribution is drawn.
#: Unit: 1. Origin: chosen.
SHARES = np.linspace(0.0, 1.0, 101)
#: Sd of the noise on each entry of the identities of Fig. 2.5.
#: Unit: 1. Origin: derived: a reading of "a signal-to-noise ratio of 10" that gives
#: distances like the printed ones, see `hopdata.maps.distances.PRINTED_READING`.
NOISE_SD = 0.1
# Distances that are named after people.
NAMES = {"fubini_study": "Fubini-Study"}

# When print and result are said to agree.
SAME_DISTANCE = 0.02
COMPARABLE_DISTANCE = 0.1
OVERLAP = 0.75
NEARLY_ALL = 0.99
ALIGNED_DEG = 1.0


def make(seeds: Sequence[int]) -> Made:
    """Measure the items of this part."""
    printed = study_of(printed=True)
    ours = study_of()
    control = study_of(CONTROL)
    apart = {
        "printed": over_seeds(lambda seed: _distances(printed, seed), seeds),
        "hopdata": over_seeds(lambda seed: _distances(ours, seed), seeds),
        "control": over_seeds(lambda seed: _distances(control, seed), seeds[:1]),
    }
    spectrum = _spectrum(ours)
    sensitivity = pd.concat(over_seeds(_sensitivity, seeds), ignore_index=True)
    rows = [
        _sections(ours, spectrum),
        _seventeen_small(ours, seeds),
        _six_distances(seeds),
        _most_sensitive(sensitivity),
        _two_norm_of_angles(seeds),
        _draws_of_thirty(printed, ours, seeds),
        _noised_identity(apart, seeds),
        _random(apart),
        _overlap(apart),
    ]
    tables = {
        "fig2_5_distances": _distributions(apart),
        "spectrum": spectrum,
        "noise_sensitivity": sensitivity,
    }
    return Made(rows, tables)


def draw(tables: Mapping[str, pd.DataFrame]) -> Mapping[str, Figure]:
    """Draw Fig. 2.5 by both methods, the spectrum, and the choice of the distance."""
    from hopdata.dissertation.figures import subspaces as figures

    return {
        "fig2_5_distances": figures.distances_figure(tables["fig2_5_distances"]),
        "spectrum": figures.spectrum_figure(tables["spectrum"]),
        "noise_sensitivity": figures.sensitivity_figure(tables["noise_sensitivity"]),
    }


def _distances(study: Study, seed: int, **options: Any) -> DistanceStudy:
    """Return the distances of a study, by its keys and these."""
    x, y = study.pairs.normalised()
    keys = {**study.config["subspaces"], **options}
    found = bootstrap_subspaces(x, y, study.pairs.schedule, seed=seed, **keys)
    return measure_distances(
        found.bases,
        found.shape,
        seed=seed,
        pairs=PAIRS,
        noise_sd=study.config["distances"]["noise_sd"],
        streams=found.streams,
    )


def _means(studies: Sequence[DistanceStudy], kind: str) -> list[float]:
    """Return the mean distance of pairs of one kind, for each study, rad."""
    found = []
    for study in studies:
        by_kind = study.summary.set_index("kind")["mean_distance"]
        found.append(float(by_kind[kind]))
    return found


# The two components of the sections, and where the true rank ends.


def _spectrum(study: Study) -> pd.DataFrame:
    """Return the sd of each principal component of the pairs, and of its noise.

    ``sd`` is measured, ``noise_sd`` what the standard errors of the states put into
    that component, ``true_sd`` the spectrum of the same landings without noise.
    """
    pairs = study.pairs
    x, y = pairs.normalised()
    components, sd = _principal(np.hstack([x, y]))
    noise = small_studies.Noise.of(pairs)
    units = small_studies.units_of(pairs)
    variances = np.concatenate([noise.x / units, noise.y / units]) ** 2
    heights = small_studies.section_heights_m(study)
    states = small_studies.landings_of(truth_of(), heights)
    before, after = small_studies.in_home_frame(states)
    _, true_sd = _principal(np.hstack([before / units, after / units]))
    columns = {
        "component": np.arange(1, len(sd) + 1),
        "sd": sd,
        "noise_sd": np.sqrt(components**2 @ variances),
        "true_sd": true_sd,
    }
    return pd.DataFrame(columns)


def _principal(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the principal components (D, D), in rows, and the sd along each."""
    centred = points - points.mean(axis=0)
    _, singular, components = np.linalg.svd(centred, full_matrices=False)
    return components, singular / np.sqrt(len(points) - 1)


def _sections(study: Study, spectrum: pd.DataFrame) -> Row:
    """Item 34: the two least components are the sections."""
    x, y = study.pairs.normalised()
    components, sd = _principal(np.hstack([x, y]))
    dimension = len(sd)
    n_markers = x.shape[1] // 6
    # A section holds the mean of the markers' heights: its normal adds these up. Places
    # (x, y, z) of all markers come first in a state, and the state after the landing
    # follows that before.
    normals = np.zeros((dimension, 2))
    for marker in range(n_markers):
        height = 3 * marker + 2
        normals[height, 0] = 1.0
        normals[x.shape[1] + height, 1] = 1.0
    angles = principal_angles(orthonormalised(normals), components[-2:].T)
    above_noise = spectrum["true_sd"] > spectrum["noise_sd"]
    true_rank = spectrum["true_sd"] > 1e-9 * spectrum["true_sd"].max()
    values = {
        "dimension": dimension,
        "left": dimension - 2,
        "angle_deg": float(np.degrees(angles).max()),
        "third_least": float(sd[-3]),
        "section": float(sd[-2]),
        "above_noise": int(above_noise.sum()),
        "true_rank": int(true_rank.sum()),
    }
    agreement = Agreement.DIFFERS
    if values["angle_deg"] < ALIGNED_DEG and sd[-2] < sd[-3] / 100:
        agreement = Agreement.PARTLY
        if values["true_rank"] >= values["left"]:
            agreement = Agreement.AGREES
    return Row(34, agreement, values, "rank")


def _seventeen_small(study: Study, seeds: Sequence[int]) -> Row:
    """Item 35: the 17 small components, read in three ways."""
    values: dict[str, Any] = {}
    for which in ("leading", "smallest", "smallest_spanned"):
        studies = [_distances(study, seed, which=which) for seed in seeds[:2]]
        values[f"{which}_in"] = _means(studies, "in_class")
        values[f"{which}_cross"] = _means(studies, "cross_class")
    pairs = zip(values["leading_in"], values["smallest_in"], strict=True)
    values["difference"] = max(abs(one - other) for one, other in pairs)
    values["arbitrary"] = SHAPE[0] - (SAMPLES - 1)
    agreement = Agreement.DIFFERS
    if values["difference"] < 1e-6:
        agreement = Agreement.BUILT
    return Row(35, agreement, values, "rank")


# The distances of Edelman, Arias and Smith, and which of them is the most sensitive.


def _six_distances(seeds: Sequence[int]) -> Row:
    """Item 36: each distance against its definition on two random subspaces."""
    largest = []
    for seed in seeds:
        generator = named_generator(seed, "six distances")
        a, b = orthonormalised(generator.standard_normal((2, *SHAPE)))
        angles = principal_angles(a, b)
        defined = _by_definition(a, b)
        errors = [
            abs(float(distance(angles)) - defined[name])
            for name, distance in DISTANCES.items()
        ]
        largest.append(max(errors))
    values = {"count": len(DISTANCES), "error": largest}
    agreement = Agreement.DIFFERS
    if max(largest) < 1e-9:
        agreement = Agreement.BUILT
    return Row(36, agreement, values)


def _by_definition(a: FloatArray, b: FloatArray) -> dict[str, float]:
    """Return the distances without principal angles, where they have such a form."""
    from scipy.linalg import orthogonal_procrustes, subspace_angles

    overlap = a.T @ b
    projections = a @ a.T - b @ b.T
    rotation, _ = orthogonal_procrustes(a, b)
    turned = a @ rotation - b
    volume = abs(float(np.linalg.det(overlap)))
    return {
        "arc_length": float(np.linalg.norm(subspace_angles(a, b))),
        "chordal_f": float(np.linalg.norm(turned)),
        "projection_f": float(np.linalg.norm(projections)) / np.sqrt(2),
        "fubini_study": float(np.arccos(volume)),
        "chordal_2": float(np.linalg.norm(turned, 2)),
        "projection_2": float(np.linalg.norm(projections, 2)),
    }


def _sensitivity(seed: int) -> pd.DataFrame:
    """Return how each distance responds to noise about that of Fig. 2.5."""
    levels = [NOISE_SD * 2.0**step for step in range(-4, 2)]
    found = noise_sensitivity(SHAPE, seed=seed, pairs=150, noise_sds=levels)
    return found.assign(seed=seed)


def _most_sensitive(sensitivity: pd.DataFrame) -> Row:
    """Item 37: which distance grows most, and most clearly, with the noise."""
    values: dict[str, Any] = {}
    first = {}
    for place, level in {"at": NOISE_SD, "below": NOISE_SD / 4}.items():
        rows = sensitivity[np.isclose(sensitivity["noise_sd"], level)]
        columns = {"mean": "mean_distance", "doubling": "doubling"}
        for what, column in columns.items():
            by_seed = rows.pivot_table(index="seed", columns="distance", values=column)
            for name in DISTANCES:
                values[f"{name}_{what}_{place}"] = by_seed[name].tolist()
            first[what, place] = str(by_seed.median().idxmax())
            values[f"first_{what}_{place}"] = NAMES.get(
                first[what, place], first[what, place].replace("_", " ")
            )
    is_first = [name == "arc_length" for name in first.values()]
    agreement = Agreement.DIFFERS
    if all(is_first):
        agreement = Agreement.AGREES
    elif any(is_first):
        agreement = Agreement.PARTLY
    return Row(37, agreement, values, "meaning")


def _two_norm_of_angles(seeds: Sequence[int]) -> Row:
    """Item 38: the arc length of subspaces whose angles are known."""
    errors = []
    for seed in seeds:
        generator = named_generator(seed, "known angles")
        angles = generator.uniform(0.0, np.pi / 2, SHAPE[1])
        frame = orthonormalised(generator.standard_normal((SHAPE[0], SHAPE[0])))
        # Each axis of the first half is turned by its angle into one of the second.
        first = frame[:, : SHAPE[1]]
        second = frame[:, SHAPE[1] :]
        other = first * np.cos(angles) + second * np.sin(angles)
        found = float(arc_length(first, other))
        errors.append(abs(found - np.linalg.norm(angles)))
    agreement = Agreement.DIFFERS
    if max(errors) < 1e-12:
        agreement = Agreement.BUILT
    return Row(38, agreement, {"error": max(errors)})


# 1000 principal component analyses of 30 landings.


def _draws_of_thirty(printed: Study, ours: Study, seeds: Sequence[int]) -> Row:
    """Item 45: draws with replacement, and those that lack components."""
    x, y = ours.pairs.normalised()
    points = np.hstack([x, y])
    lacking = []
    for seed in seeds:
        generator = named_generator(seed, "draws of thirty")
        class_of_30 = points[generator.choice(len(points), SAMPLES, replace=False)]
        draws = generator.integers(0, SAMPLES, size=(1000, SAMPLES))
        _, full = principal_subspaces(class_of_30, draws, SHAPE[1])
        lacking.append(100 * float(np.mean(~full)))
    px, py = printed.pairs.normalised()
    keys = {**printed.config["subspaces"], "incomplete": "leave_out"}
    found = bootstrap_subspaces(px, py, printed.pairs.schedule, seed=1, **keys)
    used = sum(len(bases) for bases in found.bases.values())
    asked = keys["bootstraps"] * len(found.bases)
    resampled = [_distances(ours, seed, draws="resampled") for seed in seeds[:2]]
    distinct = [_distances(ours, seed) for seed in seeds[:2]]
    values = {
        "lacking": lacking,
        "lacking_here": 100 * (1 - used / asked),
        "resampled_in": _means(resampled, "in_class"),
        "distinct_in": _means(distinct, "in_class"),
    }
    return Row(45, Agreement.BUILT, values, "replacement")


# The baselines, and Fig. 2.5.


def _noised_identity(
    apart: Mapping[str, list[DistanceStudy]], seeds: Sequence[int]
) -> Row:
    """Item 46: noised identities, and the distances within an order."""
    values: dict[str, Any] = {
        "noised": _means(apart["hopdata"], "noised_identity"),
        "printed_in": _means(apart["printed"], "in_class"),
        "ours_in": _means(apart["hopdata"], "in_class"),
    }
    readings = snr_readings(SHAPE, seed=seeds[0], pairs=300)
    others = readings[(readings["kind"] == "noised_identity") & ~readings["printed"]]
    values["least_reading"] = float(others["mean_distance"].min())
    values["largest_reading"] = float(others["mean_distance"].max())
    one = noised_identities(named_generator(seeds[0], "one"), SHAPE, 300, NOISE_SD, 1)
    values["one_noised"] = float(arc_length(*one).mean())
    off = [abs(value / NOISED_MEAN - 1) for value in values["noised"]]
    apart_from_data = []
    for method in ("printed_in", "ours_in"):
        for found, noised in zip(values[method], values["noised"], strict=True):
            apart_from_data.append(abs(found / noised - 1))
    agreement = Agreement.DIFFERS
    if max(off) < SAME_DISTANCE:
        agreement = Agreement.PARTLY
        if max(apart_from_data) < COMPARABLE_DISTANCE:
            agreement = Agreement.AGREES
    return Row(46, agreement, values, "readings")


def _random(apart: Mapping[str, list[DistanceStudy]]) -> Row:
    """Item 47: random subspaces."""
    values: dict[str, Any] = {"random": _means(apart["hopdata"], "random")}
    near = [abs(value / RANDOM_MEAN - 1) for value in values["random"]]
    for method in ("printed", "hopdata"):
        every = pd.concat([study.distances for study in apart[method]])
        by_kind = every.groupby("kind")["distance_rad"]
        unrelated = by_kind.get_group("random").quantile(1 - NEARLY_ALL)
        of_data = [by_kind.get_group(kind) for kind in ("in_class", "cross_class")]
        below = pd.concat(of_data) < unrelated
        values[f"{method}_below"] = 100 * float(below.mean())
    agreement = Agreement.DIFFERS
    lowest = min(values["printed_below"], values["hopdata_below"])
    if max(near) < SAME_DISTANCE and lowest >= 100 * NEARLY_ALL:
        agreement = Agreement.AGREES
    return Row(47, agreement, values)


def _overlap(apart: Mapping[str, list[DistanceStudy]]) -> Row:
    """Item 48: Fig. 2.5, its overlaps, and those of the control."""
    values: dict[str, Any] = {}
    holds = []
    for method, studies in apart.items():
        for kind in ("in_class", "cross_class"):
            values[f"{method}_{kind}"] = _means(studies, kind)
        above = [
            float(one.summary.set_index("kind")["auc_against_in_class"]["cross_class"])
            for one in studies
        ]
        values[f"{method}_auc"] = above
        if method == "control":
            continue
        noised = _means(studies, "noised_identity")
        unrelated = _means(studies, "random")
        across = values[f"{method}_cross_class"]
        for auc, near, far, cross in zip(above, noised, unrelated, across, strict=True):
            holds.append(auc < OVERLAP and abs(cross - near) < abs(cross - far) / 2)
    agreement = Agreement.DIFFERS
    if all(holds):
        agreement = Agreement.AGREES
    elif any(holds):
        agreement = Agreement.PARTLY
    return Row(48, agreement, values, "no_power")


def _distributions(apart: Mapping[str, list[DistanceStudy]]) -> pd.DataFrame:
    """Return quantiles of the distances of each kind, all seeds together."""
    tables = []
    for method, studies in apart.items():
        every = pd.concat([study.distances for study in studies])
        for kind in KINDS:
            values = every.loc[every["kind"] == kind, "distance_rad"]
            columns = {
                "method": method,
                "kind": kind,
                "share": SHARES,
                "distance_rad": np.quantile(values, SHARES),
            }
            tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)
