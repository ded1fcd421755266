"""The part `frame_change_claims`, in a small version, and its rules of agreement."""

import numpy as np
import pandas as pd
import pytest

from hopdata.dissertation.items import read_part
from hopdata.dissertation.parts import frame_change_claims as part
from hopdata.dissertation.rows import Agreement
from hopdata.steering import robot as plant
from hopdata.steering.models import by_schedule, residuals

ITEMS = [54, 55, 64, 79, 80]
ROBOT = plant.SteeredHopper()
SMALL = part.Effort(
    sizes=(60, 600),
    fresh=60,
    order_hops=820,
    permutations=19,
    scaled_hops=237,
    turn_hops=12,
)
COMPONENTS = ("dx", "dy", "dtheta")


@pytest.fixture(scope="module")
def made():
    return part.make([1], effort=SMALL)


def test_each_item_has_its_row_and_every_sentence_its_numbers(made):
    rows = {row.item: row for row in made.rows}
    assert (
        [one.number for one in read_part("frame_change_claims")] == ITEMS == list(rows)
    )
    for item in read_part("frame_change_claims"):
        row = rows[item.number]
        numbers = {name: float(np.median(value)) for name, value in row.values.items()}
        for sentence in (item.printed_method, item.ours, item.reasons[row.reason]):
            assert "{" not in sentence.format(**numbers)


def test_each_figure_that_an_item_names_is_drawn(made):
    named = {one.figure for one in read_part("frame_change_claims")}
    assert named == set(part.draw(made.tables))


def test_translation_is_not_zero_order_and_the_landing_is_agnostic(made):
    rows = {row.item: row for row in made.rows}
    equation, zero_order = rows[54].values, rows[55].values
    assert equation["equation_error"] < 1e-14
    assert equation["power"][0] > 1.7
    assert equation["control_power"][0] < 1.2
    assert equation["with_x"][0] < 0.05 * equation["without_x"][0]
    assert zero_order["inputs_heading"][0] > 90
    assert zero_order["inputs_y"][0] < 50
    assert zero_order["momentum_y"][0] > 80
    assert zero_order["landing_least"][0] > 5
    assert zero_order["place_mm"] < 1e-3
    assert rows[64].values["schedules"][0] <= 36


def scaled(power):
    """Return effects that fall with this power; the control's with the first."""
    rows = []
    for body, own in ((part.HOPPER, power), (part.COUPLED, 1.0)):
        for scale in part.KICK_SCALES:
            for component in COMPONENTS:
                rows.append(
                    {
                        "body": body,
                        "scale": scale,
                        "component": component,
                        "effect": 0.1 * scale**own,
                        "spread": 10 * scale,
                        "seed": 1,
                    }
                )
    return pd.DataFrame(rows)


def orders(p=0.01):
    rows = []
    for given in (residuals.INPUTS, residuals.STATE):
        for order in residuals.ORDERS:
            for component in COMPONENTS:
                rows.append(
                    {
                        "given": given,
                        "order": order,
                        "component": component,
                        "effect": 1.0,
                        "share": 0.2,
                        "p": p,
                        "seed": 1,
                    }
                )
    return pd.DataFrame(rows)


@pytest.mark.parametrize(
    ("power", "p", "agreement"),
    [
        (2.0, 0.01, Agreement.AGREES),
        (2.0, 0.005, Agreement.PARTLY),
        (1.0, 0.01, Agreement.PARTLY),
    ],
)
def test_agnostic_agrees_if_orders_matter_to_second_order_only(power, p, agreement):
    tables = {"scaled": scaled(power), "orders": orders(p)}
    row = part.equation_row(tables, 1)
    assert row.agreement is agreement
    assert row.values["power"][0] == pytest.approx(power)
    assert row.values["control_power"][0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("share", "agreement"), [(0.95, Agreement.AGREES), (0.5, Agreement.PARTLY)]
)
def test_zero_order_agrees_if_the_inputs_decide(share, agreement):
    rows = []
    for known in (
        residuals.BY_INPUTS,
        residuals.BY_HISTORY,
        residuals.BY_MOMENTUM,
        residuals.BY_STATE,
    ):
        for component in COMPONENTS:
            rows.append(
                {"known": known, "component": component, "share": share, "seed": 1}
            )
    tables = {"decided": pd.DataFrame(rows), "orders": orders()}
    assert part.zero_order_row(ROBOT, tables).agreement is agreement


def curve(first, last):
    """Return a curve of two sizes, by errors of the three models at each of them."""
    rows = []
    for hops, errors in ((100, first), (3600, last)):
        for model, rmse in zip(by_schedule.MODELS, errors, strict=True):
            for component in COMPONENTS:
                rows.append(
                    {
                        "hops": hops,
                        "model": model,
                        "component": component,
                        "rmse": rmse,
                        "seed": 1,
                    }
                )
    return pd.DataFrame(rows)


@pytest.mark.parametrize(
    ("first", "last", "agreement", "reason"),
    [
        ((1.05, 2.0, 2.0), (1.0, 1.1, 1.1), Agreement.AGREES, ""),
        ((1.05, 0.9, 2.0), (1.0, 0.8, 1.1), Agreement.PARTLY, "told"),
        ((1.05, 0.9, 0.9), (1.0, 0.8, 0.8), Agreement.PARTLY, "sooner"),
        ((2.0, 0.9, 0.9), (1.0, 0.8, 0.8), Agreement.DIFFERS, "sooner"),
    ],
)
def test_schedules_agree_if_they_never_help_below_the_printed_number(
    first, last, agreement, reason
):
    schedules = pd.DataFrame({"schedule": ["a", "b"], "hops": [200, 50], "seed": 1})
    tables = {"curve": curve(first, last), "schedules": schedules}
    row = part.schedules_row(tables, part.Effort(sizes=(100, 3600)))
    assert row.agreement is agreement
    assert row.reason == reason
    assert row.values["with_100"] == [1]
    assert row.values["commonest"] == [80.0]


def turns(left, right, drift, radius):
    swings = np.array(part.SWINGS_DEG)
    turn = np.where(swings < 0, left, -right)
    turn = np.where(swings == 0, drift, turn)
    return pd.DataFrame(
        {"swing_deg": swings, "turn_deg": turn, "radius_m": radius, "seed": 1}
    )


@pytest.mark.parametrize(
    ("radius", "agreement"),
    [(0.55, Agreement.AGREES), (0.4, Agreement.DIFFERS), (0.9, Agreement.DIFFERS)],
)
def test_a_radius_agrees_within_a_quarter(radius, agreement):
    row = part.radius_row({"turns": turns(9.0, 9.0, -1.0, radius)})
    assert row.agreement is agreement
    assert row.values["half_turn_hops"] == [20.0]


@pytest.mark.parametrize(
    ("left", "drift", "agreement"),
    [
        (8.0, -1.0, Agreement.AGREES),
        (10.0, -1.0, Agreement.PARTLY),
        (8.0, 1.0, Agreement.PARTLY),
        (10.0, 1.0, Agreement.DIFFERS),
    ],
)
def test_drift_and_weak_side_agree_by_their_signs(left, drift, agreement):
    tables = {"turns": turns(left, 9.0, drift, 0.5)}
    row = part.drift_row(ROBOT, tables, SMALL)
    assert row.agreement is agreement
    assert row.values["even_left_deg"] == pytest.approx(row.values["even_right_deg"])
