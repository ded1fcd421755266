"""Event-selection: liveness in all modes, continuity, one crossing each."""

from __future__ import annotations

import numpy as np
import pytest
from exact import octant, octant_guards
from hybrid_systems import ball, ladder, relay, sliding, throw

from hopdata.hybrid import System, field
from hopdata.hybrid.first_order import check_event_selected
from hopdata.hybrid.first_order.linearise import lock_combinations
from hopdata.hybrid.first_order.selection import (
    Finding,
    draw_around,
)

FREE = [-1, -1, -1]


def failed(report):
    return [finding.condition for finding in report.findings if not finding.passed]


def test_octant_near_its_corner():
    report = check_event_selected(octant(), [0, 0, 0], mode=FREE, radius=0.05, n_samples=40)
    assert report.passed
    assert (report.n_samples, report.n_modes) == (41, 8)
    assert report.guards == ("x", "y", "z")
    assert report.margins == pytest.approx([1, 1, 1])
    assert 0.5 < report.rates.min() < 1.0
    assert str(report).startswith("event-selected: 41 states, 8 modes")


def test_octant_farther_out_is_not():
    """dx/dt = 1 - 2 y beyond x: it turns back where y > 1/2."""
    report = check_event_selected(
        octant(), [[0, 0, 0], [0, 0.6, 0]], mode=FREE, guards=("x", "y", "z")
    )
    assert not report.passed
    assert failed(report) == ["each guard is crossed", "contact keeps penetration velocity"]
    assert report.rates[0] == pytest.approx(-0.2)


def test_one_mode_of_four_suffices_to_break_it():
    @field
    def coupled(t, y, mode, params, dy):
        both = mode[0] > 0 and mode[1] < 0
        dy[0], dy[1], dy[2] = 1.0, (-1.0 if both else 1.0), -1.0

    system = System(coupled, octant_guards, n_states=3, guard_names=("x", "y", "z"))
    report = check_event_selected(system, np.zeros(3), mode=FREE)
    np.testing.assert_array_equal(report.margins, [1, -1, 1])
    np.testing.assert_array_equal(report.kept, [1, -1, 1])
    assert not report.passed


def test_sliding_is_not_event_selected():
    report = check_event_selected(sliding(), [0.0], params=(1.0, 2.0), mode=[-1])
    assert not report.passed
    assert report.rates.tolist() == [-1.0]
    assert report.kept.tolist() == [-0.5]
    crossing = check_event_selected(sliding(), [0.0], params=(-1.0, 2.0), mode=[-1])
    assert crossing.passed
    assert crossing.kept.tolist() == [0.5]


@pytest.mark.parametrize("restitution", [0.0, 0.8])
def test_a_rigid_bounce_is_not(restitution):
    report = check_event_selected(ball(), [0, -2.0], params=(9.81, 0, restitution), mode=[-1])
    assert "trajectories are continuous" in failed(report)
    assert "contact keeps penetration velocity" in failed(report)
    assert report.kept == pytest.approx([-restitution], abs=1e-15)
    assert report.jump == pytest.approx(1 + restitution)


def test_a_velocity_lost_in_part_is_only_a_jump():
    report = check_event_selected(ball(), [0, -2.0], params=(9.81, 0, -0.7), mode=[-1])
    assert failed(report) == ["trajectories are continuous"]
    assert report.kept == pytest.approx([0.7])


def test_falling_guards_count_in_their_own_direction():
    down = check_event_selected(throw(), [1.0, -3.0], params=(9.81, 1.0), mode=[1])
    assert down.passed
    assert down.rates == pytest.approx([3.0])
    assert not check_event_selected(throw(), [1.0, -3.0], params=(9.81, 1.0), mode=[-1]).passed


def test_a_handler_that_pushes_another_guard_across_is_found():
    report = check_event_selected(
        relay(), [1.0, 0.0], mode=[-1, -1, -1], guards=("first", "second")
    )
    assert report.wrong_way > 1
    assert "each guard is crossed only once" in failed(report)


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e6])
def test_margins_do_not_depend_on_units(unit):
    report = check_event_selected(
        throw(), [1.0, -3 * unit], params=(9.81 * unit, 1.0), mode=[1],
        radius=0.1, n_samples=9, scale=[1.0, unit],
    )  # fmt: skip
    assert report.passed
    assert report.margins == pytest.approx([1.0])
    assert 2.9 * unit < report.rates[0] < 3.0 * unit


def test_more_than_eight_guards_are_sampled():
    rungs = np.r_[np.ones(10), 0.1 * np.ones(10)]
    report = check_event_selected(ladder(10), [1.0, 0.0], params=rungs, mode=[-1] * 10)
    assert report.passed
    assert report.n_modes == 256
    combinations = list(lock_combinations(range(10)))
    assert len(set(combinations)) == 256
    assert {(), tuple(range(10)), *((k,) for k in range(10))} <= set(combinations)
    assert len(list(lock_combinations((5, 2)))) == 4


def test_draws_fill_the_ball():
    drawn = draw_around(np.array([[1.0, 2.0]]), np.array([0.1, 10.0]), 4000, 7)
    assert drawn[0].tolist() == [1.0, 2.0]
    radius = np.linalg.norm((drawn[1:] - [1, 2]) / [0.1, 10], axis=1)
    assert radius.max() < 1
    assert np.mean(radius < 0.5) == pytest.approx(0.25, abs=0.02)
    assert (
        drawn.tobytes()
        == draw_around(np.array([[1.0, 2.0]]), np.array([0.1, 10.0]), 4000, 7).tobytes()
    )


def test_there_must_be_a_guard():
    with pytest.raises(ValueError, match="guards"):
        check_event_selected(octant(), [1, 1, 1], mode=FREE)


# Findings and their table.


def test_bounds():
    assert Finding.at_most("a", 1.0, 1.0, "").passed
    assert not Finding.at_most("a", 1.1, 1.0, "").passed
    assert not Finding.above("a", 1.0, 1.0, "").passed
    assert Finding.above("a", 1.1, 1.0, "").passed
    assert not Finding.at_most("a", np.nan, 1.0, "").passed
    assert not Finding.above("a", np.nan, 1.0, "").passed


def test_columns_are_aligned():
    table = Finding.table(
        [Finding.at_most("short", 0.123456, 1, "one"), Finding("longer", False, np.nan, "x", "two")]
    )
    assert table.split("\n") == [
        "     condition  found  needed  the number is",
        "yes  short      0.123  <= 1    one",
        "NO   longer     -      x       two",
    ]
