import math

import pandas as pd

from hopdata.steering.live.decisions import (
    DECISION_COLUMNS,
    Decision,
    write_decisions,
    write_states,
)
from hopdata.steering.live.states import StatusLog

PLANNED = Decision(
    stance_s=1.25,
    told_s=1.27,
    epoch=0,
    pose=(0.1, -0.2, 3.0),
    boom_angle_rad=2.5,
    pose_age_s=0.001,
    boom_age_s=0.011,
    outcome="planned",
    command_rad=-0.5,
    planning_s=0.002,
    latency_s=0.003,
    since_stance_s=0.023,
    reason="",
)


def test_the_log_of_decisions_can_be_read_back(tmp_path):
    held = Decision(**(vars(PLANNED) | {"outcome": "held", "reason": 'failed: "a, b"'}))
    write_decisions(tmp_path / "decisions.csv", [PLANNED, held])
    table = pd.read_csv(tmp_path / "decisions.csv", keep_default_na=False)
    assert tuple(table.columns) == DECISION_COLUMNS
    assert list(table.outcome) == ["planned", "held"]
    assert table.y_m[0] == -0.2
    assert table.reason[1] == 'failed: "a, b"'
    assert [p.name for p in tmp_path.iterdir()] == ["decisions.csv"]


def test_the_log_of_states_can_be_read_back(tmp_path):
    log = StatusLog()
    log.report("connecting")
    log.report("lost", "the server has hung up")
    write_states(tmp_path / "states.csv", log.history())
    table = pd.read_csv(tmp_path / "states.csv")
    assert list(table.state) == ["idle", "connecting", "lost"]
    assert table.message[2] == "the server has hung up"
    assert math.isfinite(table.at_s[0])
