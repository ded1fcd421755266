"""One model for all schedules, and one for each, where it is known which is better."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from hopdata.errors import AnalysisError
from hopdata.steering.models import by_schedule, training
from steering.made_hops import made_hops

FAST = replace(training.RECOMMENDED, restarts=0)


def errors(hops, sizes=(60, 400)):
    """Return the mean error of each model by size, relative to the one for all."""
    curve = by_schedule.schedule_curve(hops, sizes, fresh=100, options=FAST)
    wide = curve.pivot_table(
        index="hops", columns=["model", "component"], values="rmse"
    )
    for_all = wide[by_schedule.AGNOSTIC]
    return {
        model: (wide[model] / for_all).mean(axis=1).to_numpy()
        for model in by_schedule.MODELS
    }


def test_schedules_that_matter_help_where_they_are_known():
    hops = made_hops(500, by_order=2.0, order_of_state=False)
    found = errors(hops)
    assert found[by_schedule.KNOWN][-1] < 0.7
    # Chance decides the order here, so who does not know it cannot do better.
    assert found[by_schedule.UNKNOWN][-1] > 0.97


def test_schedules_that_do_not_matter_only_cost_hops():
    found = errors(made_hops(500, noise=3e-3))
    assert found[by_schedule.KNOWN][0] > 1.1
    assert found[by_schedule.KNOWN][1] > 1.0
    assert found[by_schedule.KNOWN][1] < found[by_schedule.KNOWN][0]


def test_the_conditioned_mean_is_that_of_the_process():
    hops = made_hops(80, noise=0.01)
    process = training.trained_process(hops.rows(slice(0, 40)).changes, FAST)
    changes = hops.changes
    known = changes.points
    other = replace(process, points=known[40:], outputs=changes.change[40:])
    points = known[:10] + 0.1
    found = by_schedule.conditioned_mean(process, hops.rows(slice(40, None)), points)
    np.testing.assert_allclose(found, other.mean_at(points), rtol=1e-9, atol=1e-12)


def test_a_schedule_never_seen_is_predicted_by_the_mean_of_all():
    hops = made_hops(60, order_of_state=False)
    known = hops.rows(hops.landing != "3>1>2")
    fresh = hops.rows(hops.landing == "3>1>2")
    process = training.trained_process(known.changes, FAST)
    found = by_schedule.predictions(process, known, fresh)
    np.testing.assert_array_equal(found.known, np.tile(process.offset, (len(fresh), 1)))
    assert np.isfinite(found.unknown).all()


def curve(told):
    """Return a curve in which the model for all errs by 1 at 100, 200 and 400 hops."""
    rows = []
    for hops, error in zip((100, 200, 400), told, strict=True):
        for model, rmse in ((by_schedule.AGNOSTIC, 1.0), (by_schedule.KNOWN, error)):
            rows.append({"hops": hops, "model": model, "component": "dx", "rmse": rmse})
    return pd.DataFrame(rows)


@pytest.mark.parametrize(
    ("told", "expected"),
    [
        ((1.2, 1.0, 0.8), 200.0),
        ((2.0, 2.0, 0.5), 200 * np.sqrt(2)),
        ((0.9, 0.8, 0.7), 100.0),
        ((0.9, 1.1, 1.2), np.inf),
    ],
)
def test_the_crossing_is_where_the_curves_last_meet(told, expected):
    assert by_schedule.crossing(curve(told), "dx") == pytest.approx(expected)


def test_too_few_hops_are_an_error():
    with pytest.raises(AnalysisError, match="at least 150 hops"):
        by_schedule.schedule_curve(made_hops(100), (50, 100), fresh=50)
