"""Tables of maps: three turns, in mm and degrees, with the hops behind them."""

import numpy as np
import pytest
from steered_hops import LIMIT, chained_hops

from hopdata.errors import AnalysisError
from hopdata.steering.models.map_tables import COLUMNS, map_table, training_table
from hopdata.steering.models.options import PRINTED, WITH_PREVIOUS_SWING
from hopdata.steering.models.training import trained_process

HOPS = chained_hops(40, noise=np.array([2e-3, 2e-3, 1e-2]))


def test_the_map_is_the_process_over_three_turns():
    process = trained_process(HOPS)
    table = map_table(process, LIMIT, swings=5)
    assert table["boom_angle_rad"].agg(["min", "max"]).tolist() == [-2 * np.pi, 4 * np.pi]
    assert table["swing_rad"].agg(["min", "max"]).tolist() == [-LIMIT, LIMIT]
    inputs = table[["boom_angle_rad", "swing_rad"]].to_numpy().T
    change, sd = process.change(*inputs), process.sd(*inputs)
    np.testing.assert_allclose(table["dy_mm"], 1000 * change[:, 1], atol=1e-9)
    np.testing.assert_allclose(table["dtheta_deg"], np.degrees(change[:, 2]), atol=1e-9)
    np.testing.assert_allclose(table["dx_mm_sd"], 1000 * sd[:, 0], atol=1e-9)


def test_a_process_that_is_not_periodic_shows_it():
    table = map_table(trained_process(HOPS, PRINTED), LIMIT, swings=3)
    rows = table[np.isclose(table["swing_rad"], 0)].set_index("boom_angle_rad")
    last, first = rows["dx_mm"].iloc[-1], rows["dx_mm"].iloc[0]
    assert abs(last - first) > 1


def test_training_hops_stand_there_once():
    for options in (PRINTED, WITH_PREVIOUS_SWING):
        table = training_table(trained_process(HOPS, options))
        n = len(HOPS) - (options is WITH_PREVIOUS_SWING)
        assert len(table) == n
        np.testing.assert_allclose(table[list(COLUMNS)].iloc[0, 0], 1000 * HOPS.change[-n, 0])


def test_a_process_with_history_has_no_map():
    with pytest.raises(AnalysisError, match="found one of 3 inputs"):
        map_table(trained_process(HOPS, WITH_PREVIOUS_SWING), LIMIT)
