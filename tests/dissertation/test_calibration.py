"""The hopper beside MuJoCo: its rows follow from numbers, and the numbers are right."""

from importlib.util import find_spec
from io import StringIO

import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.dissertation.figures.calibration import LINES, calibration_figure
from hopdata.dissertation.items import read_part
from hopdata.dissertation.parts import calibration
from hopdata.dissertation.parts.calibration import (
    FOLLOWED_STEP_S,
    GRID_S,
    HOPPER,
    LETTER,
    RESTARTED,
    SHOWN,
    START,
    TIGHT,
    Trajectory,
    apex_heights,
    by_hopdata,
    by_printed,
    draw,
    energy_row,
    figure_row,
    make,
    printed_solver,
    steps_with_events,
    table_row,
)
from hopdata.dissertation.report.sentences import filled
from hopdata.dissertation.rows import Agreement
from hopdata.scenes.vertical_hopper import hopper_states

needs_mujoco = pytest.mark.skipif(
    find_spec("mujoco") is None, reason="MuJoCo is not installed"
)

# The largest error in height by MuJoCo at its printed step.
BY_MUJOCO_M = 0.032


def test_apexes_lie_between_the_steps():
    time = 0.002 * np.arange(400)
    heights = 1.5 + 3.0 * (time - 0.3007) - 0.5 * 9.81 * (time - 0.3007) ** 2
    apex = 1.5 + 3.0**2 / (2 * 9.81)
    assert apex_heights(heights) == pytest.approx([apex], abs=1e-12)


def test_a_bounce_below_the_contact_length_is_no_apex():
    heights = 0.5 - 0.5 * 9.81 * (0.002 * np.arange(-100, 100)) ** 2
    assert len(apex_heights(heights)) == 0


def test_the_letter_diverges_and_restarts_do_not():
    errors = {
        "letter": by_printed("", printed_solver(LETTER)),
        "restarted": by_printed("", printed_solver(RESTARTED)),
        "tight": by_printed("", printed_solver(RESTARTED, rtol=TIGHT)),
        "short": by_printed("", printed_solver(LETTER, step_s=FOLLOWED_STEP_S)),
    }
    sizes = {name: one.largest[0] for name, one in errors.items()}
    assert sizes["letter"] > 100.0
    assert sizes["restarted"] < BY_MUJOCO_M
    assert sizes["tight"] < 0.02 * BY_MUJOCO_M
    assert sizes["short"] < 0.02 * BY_MUJOCO_M


def test_hopdata_has_the_closed_form():
    assert by_hopdata().largest.max() < 1e-12
    assert np.abs(by_hopdata().energy).max() < 1e-13


def test_steps_that_touch_a_contact():
    solution = printed_solver(LETTER, step_s=FOLLOWED_STEP_S)()
    touched = steps_with_events(solution)
    assert touched.sum() == 2 * len(solution.events) == 8
    assert len(touched) == len(solution.t) - 1


def drifting(size):
    """Return the exact path, higher by a share that grows with time."""
    exact = hopper_states(HOPPER, START[0], GRID_S)
    return Trajectory("hopdata", GRID_S, exact + np.outer([size, 0.0], GRID_S))


def test_energy_tells_where_the_method_errs():
    row = energy_row(by_hopdata())
    assert row.agreement == Agreement.AGREES
    assert row.values["share_percent"] > 50.0
    assert row.values["contact_steps"] < 0.1 * row.values["steps"]
    assert energy_row(drifting(1e-6)).agreement == Agreement.PARTLY


def with_errors(**sizes):
    names = [*SHOWN, "restarted", "MuJoCo, constant impedance"]
    sizes = {"MuJoCo": 1e-2} | {name.replace("_", " "): x for name, x in sizes.items()}
    found = {name: drifting(sizes.get(name, 1e-6)) for name in names}
    for one in found.values():
        one.states[1] += one.residuals[0]
    return found


def race(printed, restarted):
    names = ("mujoco", "printed", "restarted", "tight", "hopdata")
    times = {f"{name}_ms": 2.0 for name in names}
    ratios = {"printed_ratio": printed, "restarted_ratio": restarted}
    return times | ratios | {"tight_ratio": 3.0, "hopdata_ratio": 0.01}


@pytest.mark.parametrize(
    ("errors", "printed", "restarted", "agreement"),
    [
        ({}, 0.7, 1.5, "agrees"),
        ({"printed": 10.0}, 0.7, 1.5, "partly"),
        ({"printed": 10.0}, 0.7, 5.0, "differs"),
        ({"printed": 10.0}, 5.0, 1.5, "partly"),
        ({}, 5.0, 5.0, "differs"),
        ({"printed": 10.0, "restarted": 1.0}, 0.1, 1.5, "differs"),
    ],
)
def test_the_table_agrees_by_ratio_and_error(errors, printed, restarted, agreement):
    row = table_row(with_errors(**errors), [race(printed, restarted)] * 3, "4")
    assert row.agreement == agreement
    assert row.values["hopdata_times_faster"] == pytest.approx([100.0] * 3)


def test_the_figure_agrees_by_its_residuals():
    assert figure_row(with_errors()).agreement == Agreement.AGREES
    assert figure_row(with_errors(printed=1.0)).agreement == Agreement.PARTLY
    worse = with_errors(printed=1.0) | {"restarted, tight": drifting(1.0)}
    assert figure_row(worse).agreement == Agreement.DIFFERS


@needs_mujoco
def test_the_part_is_made_and_told(monkeypatch):
    for name, value in (("TURNS", 2), ("DROPS", 3), ("CALLS", 2)):
        monkeypatch.setattr(calibration, name, value)
    made = make([1, 2])
    rows = {row.item: row for row in made.rows}
    items = {item.number: item for item in read_part("calibration")}
    assert set(rows) == set(items) == {12, 94, 95, 96}
    for number, item in items.items():
        values = rows[number].values
        for text in (item.printed_method, item.ours, *item.reasons.values()):
            assert "{" not in filled(text, values)
        assert not rows[number].reason or rows[number].reason in item.reasons
    hops = rows[96].values
    assert hops["first_mm"] == pytest.approx(4.9, abs=0.3)
    assert all(10 < share < 90 for share in hops["gaining_percent"])
    assert rows[94].values["mujoco_error_m"] == pytest.approx(BY_MUJOCO_M, rel=0.1)
    stored = {
        name: pd.read_csv(StringIO(table.to_csv(index=False)))
        for name, table in made.tables.items()
    }
    (figure,) = draw(stored).values()
    assert text_faults(figure) == []


# The figure.


def trajectories(solvers=tuple(LINES)):
    time = np.linspace(0, 2, 101)
    parts = [
        pd.DataFrame(
            {
                "solver": solver,
                "time_s": time,
                "height_m": 1 + np.abs(np.cos(3 * time)) + size * time,
                "velocity_m_s": np.sin(3 * time) + size,
                "height_residual_m": -size * time,
                "velocity_residual_m_s": size * time,
            }
        )
        for solver, size in zip(LINES, (0.0, 3e-2, 1e2, 2e-4, 1e-14), strict=True)
        if solver in solvers
    ]
    return pd.concat(parts, ignore_index=True)


def test_four_panels_as_printed():
    figure = calibration_figure(trajectories())
    height, velocity, below, velocity_below = figure.axes
    assert [len(axes.lines) for axes in figure.axes] == [5, 5, 4, 4]
    assert (height.get_ylabel(), velocity.get_ylabel()) == (
        "height (m)",
        "velocity (m/s)",
    )
    assert below.get_yscale() == velocity_below.get_yscale() == "log"
    shown = below.lines[0]
    assert np.isnan(shown.get_ydata()[0])
    assert shown.get_ydata()[1:] == pytest.approx(3e-2 * shown.get_xdata()[1:])
    assert text_faults(figure) == []


def test_without_mujoco_and_without_anything():
    figure = calibration_figure(trajectories(("exact", "hopdata")))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "exact",
        "hopdata",
    ]
    (text,) = calibration_figure(trajectories().iloc[:0]).texts
    assert "No trajectories" in text.get_text()
