"""All cases with exact answers: no event missed, none spurious, the right end and status."""

from __future__ import annotations

import pytest
from stress_case import check, compare, judge, params_of
from stress_edges import edge_cases
from stress_gaps import gap_cases
from stress_mass import energy, long_case, mass_cases
from stress_roots import root_cases
from stress_swings import swing_cases

from hopdata.hybrid import solve


@pytest.mark.parametrize("case", params_of(gap_cases()))
def test_events_that_come_together(case):
    check(case)


@pytest.mark.parametrize("case", params_of(root_cases()))
def test_roots_that_are_hard_to_see(case):
    check(case)


def test_swings_that_just_reach_a_guard():
    wrong = [
        (str(case), verdict)
        for case in swing_cases(200)
        if not (verdict := judge(case)).right
    ]
    assert wrong == []


@pytest.mark.parametrize("case", params_of(edge_cases()))
def test_edges_of_the_time_span(case):
    check(case)


@pytest.mark.parametrize("case", params_of(mass_cases()))
def test_stiffness_damping_and_units(case):
    check(case)


def test_no_hop_is_lost_and_the_energy_stays():
    case = long_case(1000)
    solution = solve(case.system, case.t_span, case.y0, **case.options)
    verdict = compare(solution, case.answers[0])
    assert verdict.right, verdict
    drift = (
        energy(case.options["params"][1], solution.y) / energy(1e3, solution.y[:, 0])
        - 1
    )
    # Each step's error is about its tolerance; their sum is less than if all had one
    # sign.
    assert abs(drift).max() < solution.n_steps * case.options["rtol"]


def test_landings_lose_no_energy():
    """DOP853's interpolant errs by more than its step: landing on it cost 2e-14 per lift-off."""
    case = long_case(200)
    solution = solve(case.system, case.t_span, case.y0, method="dop853", **case.options)
    first, last = energy(1e3, solution.y[:, 0]), energy(1e3, solution.y_end)
    assert abs(last / first - 1.0) < 200 * 1e-14
