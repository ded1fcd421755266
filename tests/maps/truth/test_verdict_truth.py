"""The true effect of made-up exact maps, and how a verdict is scored against it."""

import numpy as np
import pytest
from made_up_landings import END, MIDDLE, POINTS, coefficients, landings

from hopdata.maps.truth.exact_map import exact_map
from hopdata.maps.truth.map_differences import input_root
from hopdata.maps.truth.verdict_truth import score_verdict, true_effect, verdict_errors

TIME_S = 0.02
ANSWER = {
    "conclusion": "different",
    "effect": {"estimate": 0.3, "low": 0.2, "high": 0.4, "upper_bound": 0.38, "detectable": 0.1},
    "test": {"p_value": 0.001},
}


def exact(*changes):
    return {
        "body_points_m": POINTS.tolist(),
        "x": MIDDLE.tolist(),
        "y": [END.tolist()] * len(changes),
        "maps": [(coefficients().T * (1 + change)).tolist() for change in changes],
    }


def test_equal_maps_have_no_effect():
    assert true_effect(exact(0.0, 0.0, 0.0), landings(40)[0], time_unit_s=TIME_S) < 1e-12


def test_effect_is_the_rms_over_the_pairs_of_schedules():
    found = true_effect(exact(-0.1, 0.1, 0.0), landings(40)[0], time_unit_s=TIME_S)
    assert found == pytest.approx(np.sqrt(np.mean([0.2**2, 0.1**2, 0.1**2])), rel=1e-9)


def test_effect_is_measured_by_predictions():
    """A change of one entry counts by what it does over the inputs that occur."""
    before = landings(40)[0]
    maps = exact(0.0, 0.0)
    changed = np.array(maps["maps"])
    changed[1, 3, 2] += 0.5
    maps["maps"] = changed.tolist()
    body = exact_map(maps, before, shape=np.empty((0, 3)), time_unit_s=TIME_S)
    root = input_root(body.inputs)
    size = np.linalg.norm(body.weights[:, None] * (changed.mean(axis=0) @ root))
    wanted = 0.5 * body.weights[3] * np.linalg.norm(root[2]) / size
    assert true_effect(maps, before, time_unit_s=TIME_S) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize(("true", "covered"), [(0.35, True), (0.1, False)])
def test_score_says_whether_the_interval_holds_the_truth(true, covered):
    entries = score_verdict(verdict_errors(true, ANSWER))
    assert entries["verdict_true_effect"]["value"] == true
    assert entries["verdict_interval_covers"]["value"] is covered


def test_no_answer_is_not_scored():
    none = {"conclusion": "cannot tell", "effect": None, "test": None}
    assert score_verdict(verdict_errors(0.1, none)) == {}
