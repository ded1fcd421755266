"""Prediction of the state after a landing (Secs. 2.1.3, 2.2.4, 2.3; Fig. 2.4).

The sample is studied twice, by the methods as printed and by ours. Small simulated
studies show what the spread of contacts does to the comparison of the models.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.dissertation import small_studies
from hopdata.dissertation.rows import Agreement, Made, Row, over_seeds
from hopdata.dissertation.sample import CONTROL, study_of, truth_of
from hopdata.maps.affine import affine_test_errors, errors_by, leave_one_out_residuals
from hopdata.maps.coordinates import (
    output_weights,
    rigid_states,
    section_coordinates,
    split_states,
)
from hopdata.maps.draws import distinct_draws, named_generator
from hopdata.maps.learning import map_error_by_landings, prediction_by_landings
from hopdata.maps.map_norms import map_differences
from hopdata.maps.prediction import (
    DRAWS,
    MODELS,
    bootstrap_prediction,
    select_populations,
    summarise_errors,
)
from hopdata.maps.truth.maps import exact_map
from hopdata.maps.unseen import leave_one_order_out
from hopdata.rigid import body_shape
from hopdata.scenes.scene import Control
from hopdata.synthesis.landings import SectionHeights
from hopdata.synthesis.scaling import (
    common_scene,
    exact_maps,
    scaled_landings,
    true_states,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hopdata.synthesis.scaling import KnownScene, TrueStates
    from hopdata.walk import Study

# What the dissertation prints.
PRINTED_WORST_MM = 4.0
PRINTED_WORST_M_S = 0.14
PRINTED_TRAVEL_MM = 140.0
PRINTED_IMPACTS = 100

AFFINE = ("specialised", "near", "all", "far")
#: Numbers of landings to learn from.
#: Unit: landings. Origin: chosen: about doubled each time, to what the sample has.
SIZES = (25, 50, PRINTED_IMPACTS, 200, 400, 800, 1400)
#: Spreads of the small studies, over that of the sample.
#: Unit: 1. Origin: chosen.
SCALES = (0.25, 0.5, 1.0, 2.0)
#: Deviations of the noise-free landings, over those of the sample.
#: Unit: 1. Origin: chosen: halved each time.
DEVIATIONS = (1.0, 0.5, 0.25, 0.125, 0.0625)
#: Hops of a small study.
#: Unit: hops. Origin: chosen: a study takes a second.
SMALL_HOPS = 900
#: Bootstraps of a small study.
#: Unit: 1. Origin: chosen.
SMALL_BOOTSTRAPS = 60
#: Landings of the sample that are integrated with smaller deviations.
#: Unit: landings. Origin: chosen.
MOST_SCALED = 800
#: That of the sample's control: a leg has a fifth less force for each leg that does not
#: yet stand.
#: Unit: 1. Origin: convention: config/sample_control.yaml.
COUPLING = 0.2

# When print and result are said to agree.
COMPARABLE = 1.25
OUTDONE = 0.5
# "On the order of" a number: no more than twice, no less than half of it.
SAME_ORDER = 2.0


def make(seeds: Sequence[int]) -> Made:
    """Measure the items of this part."""
    printed = study_of(printed=True)
    ours = study_of()
    control = study_of(CONTROL)
    boxes = {
        "printed": _bootstraps(printed, seeds),
        "hopdata": _bootstraps(ours, seeds),
    }
    spread = _spreads(ours, seeds)
    unseen = _unseen_when_near(ours)
    learning = _learning(ours, seeds)
    rows = [
        _enough_impacts(learning),
        _least_squares(ours, seeds),
        _means(boxes),
        _replacement(printed, ours, seeds),
        _worst(printed, ours, boxes),
        _travel(printed, ours, boxes),
        _near_and_far(ours, printed, boxes),
        _six_boxes(boxes),
        _specialised_or_not(boxes, spread),
        _norms(ours, control, seeds),
        _never_trained_on(ours, control, unseen, seeds),
    ]
    tables = {
        "fig2_4_boxes": pd.concat([_summary(boxes, name) for name in boxes]),
        "ratio_by_spread": spread,
        "unseen_order": unseen,
        "impacts": learning,
    }
    return Made(rows, tables)


def draw(tables: Mapping[str, pd.DataFrame]) -> Mapping[str, Figure]:
    """Draw Fig. 2.4 by both methods, and what the text leaves open."""
    from hopdata.dissertation.figures import prediction as figures

    return {
        "fig2_4_prediction": figures.boxes_figure(tables["fig2_4_boxes"]),
        "ratio_by_spread": figures.ratio_figure(tables["ratio_by_spread"]),
        "unseen_order": figures.unseen_figure(tables["unseen_order"]),
        "impacts": figures.impacts_figure(tables["impacts"]),
    }


# Fig. 2.4: the bootstraps of the six models.


def _bootstraps(study: Study, seeds: Sequence[int]) -> list[pd.DataFrame]:
    """Return the errors of all bootstraps, a table for each seed."""
    return over_seeds(lambda seed: _bootstrap(study, seed), seeds)


def _bootstrap(study: Study, seed: int, **options: Any) -> pd.DataFrame:
    """Return the errors of a study's bootstraps, by its keys and these."""
    pairs = study.pairs
    x, y = pairs.normalised()
    keys = {**study.config["prediction"], **options}
    found = bootstrap_prediction(
        x,
        y,
        pairs.schedule,
        pairs.spread_s,
        length_unit_m=pairs.length_unit_m,
        time_unit_s=pairs.time_unit_s,
        seed=seed,
        **keys,
    )
    return found.errors


def _summary(boxes: Mapping[str, list[pd.DataFrame]], method: str) -> pd.DataFrame:
    """Return what the boxes of a method show: a row a model, over all seeds."""
    summary = summarise_errors(pd.concat(boxes[method]))
    summary.insert(0, "method", method)
    return summary


def _medians(tables: list[pd.DataFrame]) -> list[dict[str, float]]:
    """Return the median error of each model, for each seed."""
    found = []
    for table in tables:
        by_model = table.groupby("model")["mse"].median()
        found.append({name: float(by_model[name]) for name in MODELS})
    return found


def _ratios(tables: list[pd.DataFrame], above: str, below: str) -> list[float]:
    """Return the median error of one model over that of another, for each seed."""
    return [median[above] / median[below] for median in _medians(tables)]


def _least_squares(study: Study, seeds: Sequence[int]) -> Row:
    """Item 32: fits are those of ordinary least squares."""
    from sklearn.linear_model import LinearRegression

    x, y = study.pairs.normalised()
    largest = []
    for seed in seeds:
        generator = named_generator(seed, "least squares")
        fitted, tested = distinct_draws(generator, len(x), (120, 41), 20)
        ours = affine_test_errors(x, y, fitted, tested)
        theirs = errors_by(LinearRegression(), x, y, fitted, tested)
        largest.append(float(np.abs(ours / theirs - 1).max()))
    agreement = Agreement.DIFFERS
    if max(largest) < 1e-9:
        agreement = Agreement.BUILT
    return Row(32, agreement, {"difference": largest, "fits": 20 * len(seeds)})


def _means(boxes: Mapping[str, list[pd.DataFrame]]) -> Row:
    """Item 33: affine models against their mean predictors."""
    values: dict[str, Any] = {}
    holds = []
    for method, tables in boxes.items():
        specialised = _ratios(tables, "specialised", "specialised_mean")
        unspecialised = _ratios(tables, "all", "mean")
        values[f"{method}_specialised"] = _percent(specialised)
        values[f"{method}_all"] = _percent(unspecialised)
        for pair in zip(specialised, unspecialised, strict=True):
            comparable = max(pair) / min(pair) < COMPARABLE
            holds.append(comparable and max(pair) < OUTDONE)
    agreement = Agreement.DIFFERS
    if all(holds):
        agreement = Agreement.AGREES
    return Row(33, agreement, values)


def _replacement(printed: Study, ours: Study, seeds: Sequence[int]) -> Row:
    """Item 39: what "bootstraps with a 120/41 split" may mean."""
    values: dict[str, Any] = {"bootstraps": 1000, "train": 120, "test": 41}
    generator = named_generator(1, "replacement")
    for name, drawn in DRAWS.items():
        fitted, tested = drawn(generator, 276, (120, 41), 200)
        pairs = zip(tested, fitted, strict=True)
        # Share of the tested landings that the map was fitted to.
        shared = np.mean([np.isin(test, fit).mean() for test, fit in pairs])
        distinct = np.mean([len(np.unique(fit)) for fit in fitted])
        values[f"{name}_shared"] = 100 * float(shared)
        values[f"{name}_distinct"] = float(distinct)
    for name in DRAWS:
        tables = [_bootstrap(ours, seed, draws=name, bootstraps=100) for seed in seeds]
        medians = _medians(tables)
        values[f"{name}_mse"] = [1e3 * one["specialised"] for one in medians]
    values["class_sizes"] = _class_sizes(ours)
    values["printed_class_sizes"] = _class_sizes(printed)
    return Row(39, Agreement.BUILT, values, "readings")


def _class_sizes(study: Study) -> str:
    """Return the number of landings of each order, in words."""
    _, counts = np.unique(study.pairs.schedule, return_counts=True)
    return ", ".join(str(count) for count in counts)


def _worst(printed: Study, ours: Study, boxes: Mapping[str, list[pd.DataFrame]]) -> Row:
    """Item 40: the largest errors, of a split and of a single landing."""
    values: dict[str, Any] = {}
    agrees = {}
    for method, study in {"printed": printed, "hopdata": ours}.items():
        millimetres, metres_per_second = _worst_of_splits(boxes, method)
        ratios = (millimetres / PRINTED_WORST_MM, metres_per_second / PRINTED_WORST_M_S)
        agrees[method] = all(1 / SAME_ORDER < one < SAME_ORDER for one in ratios)
        values[f"{method}_mm"] = millimetres
        values[f"{method}_m_s"] = metres_per_second
        single_mm, single_m_s = _largest_single(study)
        values[f"{method}_single_mm"] = single_mm
        values[f"{method}_single_m_s"] = single_m_s
    agreement = Agreement.DIFFERS
    if all(agrees.values()):
        agreement = Agreement.AGREES
    elif agrees["printed"]:
        agreement = Agreement.PARTLY
    return Row(40, agreement, values, "filter")


def _worst_of_splits(
    boxes: Mapping[str, list[pd.DataFrame]], method: str
) -> tuple[float, float]:
    """Return the rms errors of the worst coordinate and affine model, mm and m/s.

    They are exceeded in 2.5 % of the splits.
    """
    worst = _summary(boxes, method).set_index("model").loc[list(AFFINE)]
    return (
        float(worst["worst_position_mm"].max()),
        float(worst["worst_velocity_m_s"].max()),
    )


def _largest_single(study: Study) -> tuple[float, float]:
    """Return the largest error in a coordinate of specialised maps, mm and m/s.

    Each landing is predicted from all others of its order.
    """
    pairs = study.pairs
    errors = []
    for order in np.unique(pairs.schedule):
        rows = pairs.schedule == order
        errors.append(leave_one_out_residuals(pairs.x[rows], pairs.y[rows]))
    sizes = np.abs(np.concatenate(errors))
    position, velocity = np.split(sizes, 2, axis=1)
    return 1e3 * float(position.max()), float(velocity.max())


def _travel(
    printed: Study, ours: Study, boxes: Mapping[str, list[pd.DataFrame]]
) -> Row:
    """Item 41: how far the body travels, against which the worst error is small."""
    values: dict[str, Any] = {}
    for method, study in {"printed": printed, "hopdata": ours}.items():
        sections = study.sections
        travel_mm = 1e3 * (sections.pre_height_m - sections.post_height_m)
        worst_mm, _ = _worst_of_splits(boxes, method)
        values[f"{method}_mm"] = travel_mm
        values[f"{method}_share"] = 100 * worst_mm / travel_mm
    agreement = Agreement.DIFFERS
    if min(values["printed_mm"], values["hopdata_mm"]) >= PRINTED_TRAVEL_MM:
        agreement = Agreement.AGREES
    return Row(41, agreement, values)


def _near_and_far(
    ours: Study, printed: Study, boxes: Mapping[str, list[pd.DataFrame]]
) -> Row:
    """Item 42: near and far, divided at the median spread of the contacts."""
    values: dict[str, Any] = {}
    in_order = []
    for method, study in {"printed": printed, "hopdata": ours}.items():
        pairs = study.pairs
        populations, _ = select_populations(pairs.schedule, pairs.spread_s, 40)
        sizes = {one.kind: len(one.rows) for one in populations}
        values[f"{method}_near"] = sizes["near"]
        values[f"{method}_far"] = sizes["far"]
        values[f"{method}_spread_ms"] = 1e3 * float(np.nanmedian(pairs.spread_s))
        values[f"{method}_far_over_near"] = _ratios(boxes[method], "far", "near")
        for median in _medians(boxes[method]):
            in_order.append(median["near"] < median["all"] < median["far"])
    agreement = Agreement.DIFFERS
    if all(in_order):
        agreement = Agreement.AGREES
    return Row(42, agreement, values)


def _six_boxes(boxes: Mapping[str, list[pd.DataFrame]]) -> Row:
    """Item 43: the six boxes of Fig. 2.4."""
    values: dict[str, Any] = {}
    holds = []
    for method, tables in boxes.items():
        medians = _medians(tables)
        for model in MODELS:
            values[f"{method}_{model}"] = [1e3 * one[model] for one in medians]
        for median in medians:
            worst_affine = max(median[name] for name in AFFINE)
            of_means = min(median["mean"], median["specialised_mean"])
            rises = median["near"] < median["all"] < median["far"]
            holds.append(rises and worst_affine < of_means)
    agreement = Agreement.DIFFERS
    if all(holds):
        agreement = Agreement.AGREES
    return Row(43, agreement, values, "order")


# "Specialised" against "all", by the spread of the contacts.


def _spreads(study: Study, seeds: Sequence[int]) -> pd.DataFrame:
    """Return the ratio of the models' errors in small studies, a row a study."""
    heights = small_studies.section_heights_m(study)
    noise = small_studies.Noise.of(study.pairs)
    units = small_studies.units_of(study.pairs)
    rows = []
    for seed in seeds:
        for scale in SCALES:
            truth = small_studies.hops_with_spread(scale, SMALL_HOPS, seed)
            for case, coupling in {"C1": 0.0, "control": COUPLING}.items():
                states = small_studies.landings_of(truth, heights, coupling)
                exact = small_studies.in_home_frame(states)
                names = (case, str(scale))
                noisy = small_studies.with_noise(exact, noise, seed, *names)
                spread_ms = 1e3 * float(np.median(states.spread_s))
                for seen, (x, y) in {"noise": noisy, "none": exact}.items():
                    ratio = _all_over_specialised(x / units, y / units, states, seed)
                    rows.append((seed, scale, case, seen, spread_ms, ratio))
    columns = ["seed", "scale", "case", "noise", "spread_ms", "ratio"]
    return pd.DataFrame(rows, columns=columns)


def _all_over_specialised(
    x: FloatArray, y: FloatArray, states: TrueStates, seed: int
) -> float:
    """Return the error of one map for all orders over that of a map for each."""
    found = bootstrap_prediction(
        x,
        y,
        states.schedule,
        states.spread_s,
        seed=seed,
        bootstraps=SMALL_BOOTSTRAPS,
    )
    median = found.summary.set_index("model")["median_mse"]
    return float(median["all"] / median["specialised"])


def _specialised_or_not(
    boxes: Mapping[str, list[pd.DataFrame]], spread: pd.DataFrame
) -> Row:
    """Item 44: whether maps of one order predict better than one map for all."""
    values: dict[str, Any] = {}
    ratios = []
    for method, tables in boxes.items():
        values[f"{method}_ratio"] = _ratios(tables, "all", "specialised")
        ratios += values[f"{method}_ratio"]
    names = {0.25: "quarter", 0.5: "half", 1.0: "full", 2.0: "double"}
    for scale, name in names.items():
        of_scale = spread[spread["scale"] == scale]
        for (case, noise), rows in of_scale.groupby(["case", "noise"]):
            values[f"{case}_{noise}_{name}"] = rows["ratio"].tolist()
    agreement = Agreement.DIFFERS
    if max(ratios) < COMPARABLE:
        agreement = Agreement.AGREES
    elif max(values["C1_noise_quarter"]) < COMPARABLE:
        agreement = Agreement.PARTLY
    return Row(44, agreement, values, "spread")


# Maps in two norms.


@dataclass(frozen=True)
class _Rigid:
    """Landings of a study in rigid-body coordinates, and weights of the outcomes."""

    x: FloatArray
    y: FloatArray
    shape: FloatArray
    weights: FloatArray


def _rigid(study: Study) -> _Rigid:
    """Return the landings of a study, with the shape of its own body."""
    pairs = study.pairs
    shape = body_shape(split_states(pairs.x)[0])
    before = rigid_states(pairs.x, shape)
    after = rigid_states(pairs.y, shape)
    x, y = section_coordinates(before, after)
    return _Rigid(x, y, shape, output_weights(shape, pairs.time_unit_s))


def _norms(ours: Study, control: Study, seeds: Sequence[int]) -> Row:
    """Item 49: differences between maps of orders over those between halves of one."""
    values: dict[str, Any] = {}
    for case, study in {"c1": ours, "control": control}.items():
        rigid = _rigid(study)
        spread = study.pairs.spread_s
        is_near = spread < np.nanmedian(spread)
        for where, rows in {"near": is_near, "all": np.isfinite(spread)}.items():
            outcomes = (rigid.y * rigid.weights)[rows]
            inputs = rigid.x[rows]
            schedule = study.pairs.schedule[rows]
            found = [
                map_differences(inputs, outcomes, schedule, seed=seed) for seed in seeds
            ]
            for norm in ("operator", "frobenius"):
                ratios = [_across_over_within(table, norm) for table in found]
                values[f"{case}_{norm}_{where}"] = ratios
    agreement = Agreement.DIFFERS
    if max(values["c1_operator_near"]) < COMPARABLE:
        agreement = Agreement.AGREES
    elif max(values["c1_operator_near"]) < min(values["control_operator_near"]):
        agreement = Agreement.PARTLY
    return Row(49, agreement, values, "curvature")


def _across_over_within(differences: pd.DataFrame, norm: str) -> float:
    """Return the median difference between orders over that within one."""
    median = differences.groupby("kind")[norm].median()
    return float(median["cross_class"] / median["in_class"])


# How many impacts suffice.


def _learning(study: Study, seeds: Sequence[int]) -> pd.DataFrame:
    """Return errors by number of landings: of predictions, and of the map itself."""
    x, y = study.pairs.normalised()
    rigid = _rigid(study)
    truth = truth_of()
    scene = common_scene([truth])
    heights = _sections_of(study, scene)
    exact = exact_map(
        exact_maps([truth], heights),
        true_states(truth, scene, heights).x,
        shape=rigid.shape,
        time_unit_s=study.pairs.time_unit_s,
    )
    tables = []
    for seed in seeds:
        predicted = prediction_by_landings(x, y, SIZES, seed=seed)
        share = predicted[["median_error", "q05", "q95"]].div(
            predicted["of_mean"], axis=0
        )
        predicted = predicted[["landings"]].join(share)
        tables.append(predicted.assign(what="prediction", seed=seed))
        of_map = map_error_by_landings(exact, rigid.x, rigid.y, SIZES, seed=seed)
        tables.append(of_map.assign(what="map", seed=seed))
    return pd.concat(tables, ignore_index=True)


def _sections_of(study: Study, scene: KnownScene) -> SectionHeights:
    """Return the sections of a study, with the body markers that it names."""
    pre_m, post_m = small_studies.section_heights_m(study)
    body = study.config["markers"]["body"]
    return SectionHeights(pre_m, post_m, scene.points_of(body))


def _enough_impacts(learning: pd.DataFrame) -> Row:
    """Item 10: whether 100 impacts suffice for an accurate model."""
    values: dict[str, Any] = {}
    for what, rows in learning.groupby("what"):
        by_size = rows.pivot_table(
            index="seed", columns="landings", values="median_error"
        )
        most = by_size.columns.max()
        values[f"{what}_100"] = _percent(by_size[PRINTED_IMPACTS].tolist())
        values[f"{what}_most"] = _percent(by_size[most].tolist())
        values[f"{what}_landings"] = int(most)
        values[f"{what}_ratio"] = (by_size[PRINTED_IMPACTS] / by_size[most]).tolist()
    agreement = Agreement.DIFFERS
    # Accurate: it leaves less than a tenth of the variation, as all landings do.
    if max(values["prediction_100"]) < 10 and max(values["map_ratio"]) < COMPARABLE:
        agreement = Agreement.AGREES
    return Row(10, agreement, values, "curvature")


# An order that was never trained on.


def _unseen_when_near(study: Study) -> pd.DataFrame:
    """Return errors for an unseen order as the landings draw together, without noise.

    The landings of the sample, and of its control from the same apexes, are integrated
    with smaller and smaller deviations from the simultaneous contact. The preloads of
    the legs are inputs beside the state, so that nothing is left to chance.
    """
    truth = truth_of()
    scene = common_scene([truth])
    heights = _sections_of(study, scene)
    shape = heights.points_m - heights.centre_m
    weights = output_weights(shape, study.pairs.time_unit_s)
    cases = {"C1": Control(), "control": Control(coupling=COUPLING)}
    landings = scaled_landings(
        scene.scene,
        cases,
        truth.apex_states[:MOST_SCALED],
        truth.preloads_n[:MOST_SCALED],
        heights,
        scales=DEVIATIONS,
    )
    rows = []
    for found in landings:
        inputs = np.hstack([found.x, found.preloads_n])
        table = leave_one_order_out(inputs, found.y * weights, found.schedule, seed=1)
        of_all = np.sqrt(table[["unseen", "seen", "of_mean"]].mean())
        unseen = of_all["unseen"] / of_all["of_mean"]
        seen = of_all["seen"] / of_all["of_mean"]
        spread_ms = 1e3 * float(np.median(found.contact_s.std(axis=1)))
        rows.append((found.case, found.scale, spread_ms, unseen, seen))
    columns = ["case", "scale", "spread_ms", "unseen", "seen"]
    return pd.DataFrame(rows, columns=columns)


def _never_trained_on(
    ours: Study, control: Study, near: pd.DataFrame, seeds: Sequence[int]
) -> Row:
    """Item 50: an order is predicted from the others."""
    values: dict[str, Any] = {}
    for case, study in {"c1": ours, "control": control}.items():
        x, y = study.pairs.normalised()
        shares = []
        ratios = []
        for seed in seeds:
            table = leave_one_order_out(x, y, study.pairs.schedule, seed=seed)
            mean = table[["unseen", "seen", "of_mean"]].mean()
            shares.append(100 * float(np.sqrt(mean["unseen"] / mean["of_mean"])))
            ratios.append(float(mean["unseen"] / mean["seen"]))
        values[f"{case}_share"] = shares[0]
        values[f"{case}_over_seen"] = ratios
        units = small_studies.units_of(study.pairs)
        noise = small_studies.Noise.of(study.pairs).y / units
        noise_share = np.sqrt(np.mean(noise**2) / table["of_mean"].mean())
        values[f"{case}_noise"] = 100 * float(noise_share)
    nearest = near["scale"].min()
    for case in ("C1", "control"):
        by_scale = near[near["case"] == case].set_index("scale")["unseen"]
        values[f"near_{case}"] = 100 * float(by_scale[nearest])
        values[f"full_{case}"] = 100 * float(by_scale[1.0])
    values["nearest_ms"] = float(near.loc[near["scale"] == nearest, "spread_ms"].min())
    agreement = Agreement.DIFFERS
    falls = values["near_C1"] < values["full_C1"] / 4
    stays = values["near_control"] > values["full_control"] / 2
    if falls and stays:
        agreement = Agreement.AGREES
    return Row(50, agreement, values, "two_sided")


def _percent(shares: Sequence[float]) -> list[float]:
    return [100 * share for share in shares]
