"""The campaign of the verdict: it repeats, goes on, survives errors, and counts right."""

import csv
import re

import numpy as np
import pandas as pd
import pytest
import verdict_campaign
from bodies import REPORT, Body
from body_motion import MECHANISMS
from body_seen import Seen, study
from verdict_campaign import (
    COLUMNS,
    all_cells,
    cell,
    cell_table,
    detectable_table,
    finished,
    main,
    read,
    run,
    settings_of,
    studies_of,
    tables,
)
from verdict_rivals import RIVALS, rivals


@pytest.fixture
def small(monkeypatch):
    """Let scenes have 300 landings and the verdict few flips, and list a few cells."""
    monkeypatch.setattr(verdict_campaign.Scene, "simulated", 300)
    scenes = [cell(300, feet=2), cell(300, mechanism="clutch", feet=2)]
    noisier = cell(300, feet=2, noise_mm=1.5)
    monkeypatch.setattr(verdict_campaign, "all_cells", lambda: [*scenes, noisier])
    monkeypatch.setattr(verdict_campaign, "FLIPS", 99)
    monkeypatch.setattr(verdict_campaign, "AVERAGED_OVER", 5)
    return [*scenes, noisier]


def rows_of(file):
    with file.open(newline="") as rows:
        return list(csv.DictReader(rows))


def without_time(rows):
    kept = [{k: v for k, v in row.items() if k != "judge_s"} for row in rows]
    return sorted(kept, key=lambda row: (row["cell"], row["seed"]))


def test_the_campaign_has_the_conditions_that_it_promises():
    cells = all_cells()
    assert len({one.name for one in cells}) == len(cells)
    assert len(cells) * verdict_campaign.STUDIES >= 3000
    assert {one.scene.mechanism for one in cells} == set(MECHANISMS)
    assert {one.scene.feet for one in cells} == {2, 3, 4, 6}
    told = {
        key: {settings_of(one)[key] for one in cells} for key in ("fault", "errors")
    }
    assert len(told["fault"]) == 5
    assert told["errors"] == set(verdict_campaign.ERRORS)
    twins = {one.name.partition(",")[2] for one in cells if one.scene.mechanism == "c1"}
    alone = [one.name for one in cells if one.name.partition(",")[2] not in twins]
    assert not alone


def test_a_run_goes_on_where_it_was_interrupted_and_repeats(tmp_path, small):
    whole = tmp_path / "whole.csv"
    run(whole, small, range(1000, 1002), jobs=1)
    rows = rows_of(whole)
    assert len(rows) == 6
    assert not [row["error"] for row in rows if row["error"]]

    torn = tmp_path / "torn.csv"
    lines = whole.read_text().splitlines(keepends=True)
    torn.write_text("".join(lines[:3]) + lines[3][:40])
    assert len(finished(torn)) == 2
    run(torn, small, range(1000, 1002), jobs=2)
    assert without_time(rows_of(torn)) == without_time(rows)
    before = torn.read_bytes()
    run(torn, small, range(1000, 1002), jobs=1)
    assert torn.read_bytes() == before

    torn.write_text("cell,seed\nold,1\n")
    with pytest.raises(SystemExit, match="another version"):
        finished(torn)


def test_a_filter_is_told_as_a_study_tells_it(small):
    """Below one of half a landing's length there is no number; a milder one passes."""
    told = ("low-passed", "low-passed at 12 Hz", "low-passed, not told")
    cells = [cell(300, mechanism="clutch", feet=2, errors=errors) for errors in told]
    low, mild, silent = studies_of(cells[0].scene, 1000, cells)
    assert low["conclusion"] == "cannot tell"
    assert "upper_bound" not in low
    # Two filters are two recordings: either may have the larger bound.
    assert mild["upper_bound"] > 0.0
    assert silent["upper_bound"] > 0.0
    assert mild["upper_bound"] != silent["upper_bound"]


def test_an_error_is_a_row_and_no_end(monkeypatch, small):
    told = studies_of(small[0].scene, 1000, [small[0], small[2]])
    assert [row.get("error") for row in told] == [None, None]
    assert told[0]["true_kink"] == told[1]["true_kink"]
    assert told[0]["estimate"] != told[1]["estimate"]

    def fails(*_):
        raise ZeroDivisionError("of\nno use")

    monkeypatch.setattr(verdict_campaign, "asked", fails)
    told = studies_of(small[0].scene, 1000, [small[0]])
    assert told[0]["error"] == "ZeroDivisionError: of no use"
    monkeypatch.setattr(verdict_campaign, "moved", fails)
    told = studies_of(small[0].scene, 1000, [small[0], small[2]])
    assert [row["error"][:17] for row in told] == 2 * ["ZeroDivisionError"]


def made_up(name, numbers):
    """Return rows of a cell: pairs of what the verdict says and the truth."""
    rows = []
    for seed, (low, bound, truth) in enumerate(numbers):
        row = dict.fromkeys(COLUMNS, np.nan) | settings_of(name)
        row |= {"seed": REPORT[0] + seed, "error": "", "low": low, "high": bound}
        row |= {"upper_bound": bound, "estimate": 0.5 * bound, "detectable": 0.3}
        row |= {"true_kink": truth, "true_jump": 0.0, "conclusion": "cannot tell"}
        row |= {one: float(seed) for one in RIVALS}
        row |= {f"{one}_found": 1 for one in RIVALS}
        if low > 0:
            row["conclusion"] = "different"
        rows.append(row)
    return rows


def test_the_tables_count_what_the_rows_say(tmp_path, small):
    same, other, _ = small
    told = made_up(same, [(0.0, 0.2, 0.0), (0.1, 0.2, 0.0), (0.0, 0.2, 0.0)])
    told += made_up(other, [(0.1, 0.4, 0.3), (0.0, 0.2, 0.3), (0.1, 0.4, 0.6)])
    told.append(dict(told[-1], seed=1003, error="ValueError: bad", conclusion=""))
    file = tmp_path / "rows.csv"
    pd.DataFrame(told)[COLUMNS].to_csv(file, index=False)
    table = cell_table(read(file)).set_index("mechanism")
    assert table.loc["c1", "called_different"] == pytest.approx(1 / 3)
    assert table.loc["c1", "bound_holds"] == 1.0
    assert np.isnan(table.loc["c1", "bound_holds_average"])
    assert table.loc["clutch", "failed"] == 1
    assert table.loc["clutch", "studies"] == 4
    assert table.loc["clutch", "bound_holds"] == pytest.approx(1 / 3)
    assert table.loc["clutch", "interval_holds"] == pytest.approx(1 / 3)
    assert table.loc["clutch", "estimate_over_true"] == pytest.approx(1 / 3)
    # The largest statistic of three C1 studies is not exceeded by 0, 1 and 2.
    assert table.loc["clutch", "chow_equal"] == 0.0
    assert table.loc["clutch", "chow_found"] == 1.0
    assert set(table["seeds"]) == {"report"}
    promised = detectable_table(read(file)).set_index("mechanism")
    assert promised.loc["clutch", "studies"] == 2  # 0.6 is twice what is detectable
    assert promised.loc["clutch", "found_share"] == 0.5
    only_same = detectable_table(read(file).query("mechanism == 'c1'"))
    assert not len(only_same)
    assert list(only_same.columns) == verdict_campaign.OF_PROMISE


def test_bounds_of_what_saturates_are_counted_for_what_they_say(tmp_path, small):
    stick = cell(300, mechanism="stick", feet=2)
    told = made_up(stick, [(0.0, np.inf, 0.8), (0.0, 0.9, 0.8), (0.0, 0.4, 0.8)])
    for row, saturates, over in zip(told, (1, 0, 0), (0.4, 0.4, 0.4), strict=True):
        row |= {"saturates": saturates, "over_upper_bound": over, "true_average": 0.3}
    file = tmp_path / "rows.csv"
    pd.DataFrame(told)[COLUMNS].to_csv(file, index=False)
    table = cell_table(read(file)).iloc[0]
    assert table["saturates"] == pytest.approx(1 / 3)
    assert table["bound_holds"] == 0.5
    assert table["bound_holds_average"] == 1.0
    assert table["bound_median"] == 0.9


def test_the_program_writes_its_tables(tmp_path, small, monkeypatch):
    out = tmp_path / "verdict_campaign.csv"
    words = ["x", "--out", str(out), "--studies", "1", "--cells", "clutch"]
    monkeypatch.setattr("sys.argv", [*words, "--jobs", "1"])
    main()
    assert list(pd.read_csv(out)["mechanism"]) == ["clutch"]
    rows = rows_of(tmp_path / "verdict_campaign_studies.csv")
    assert [row["seed"] for row in rows] == ["1000"]
    assert 0.1 < float(rows[0]["true_kink"]) < 0.7
    out.unlink()
    tables(out, tmp_path / "verdict_campaign_studies.csv")
    assert out.is_file()
    assert re.search(
        "clutch", out.with_name("verdict_campaign_detectable.csv").read_text()
    )


def test_rivals_find_a_large_kink_and_are_quiet_without():
    told = {}
    for mechanism in ("c1", "clutch"):
        body = Body(3, mechanism, strength=1.5, spread_s=0.005)
        landings = body.landings(600, np.random.default_rng(1))
        seen = study(body, landings, np.random.default_rng(2), Seen(noise_m=0.0002))
        told[mechanism] = rivals(seen.x, seen.y, seen.instants, 1)
        assert told[mechanism] == rivals(seen.x, seen.y, seen.instants, 1)
    assert set(told["c1"]) == set(RIVALS)
    for name in RIVALS:
        assert told["clutch"][name][0] > told["c1"][name][0]
    assert told["clutch"]["kinks_and_steps"][1]
    assert not told["c1"]["kinks_and_steps"][1]
