"""A method that a user adds: the page's example, and coefficients that do not fit."""

from __future__ import annotations

from dataclasses import replace

import pytest
from pages import run_page

from hopdata.hybrid.methods import table
from hopdata.hybrid.methods.explicit import DOP853, DOPRI5, Tableau, check_tableau
from hopdata.hybrid.methods.table import add_method, choices


@pytest.fixture
def no_more_methods(monkeypatch):
    monkeypatch.setattr(table, "TABLEAUS", dict(table.TABLEAUS))


def test_the_page_adds_a_method(no_more_methods, capsys):
    names = run_page("integrator_method")
    assert "tsit5" in choices()
    with pytest.raises(ValueError, match="name: expected one that no method has"):
        add_method("tsit5", DOPRI5)
    add_method("tsit5", names["TSIT5"])  # as where a cell of a notebook runs again


@pytest.mark.parametrize("name", ["auto", "rosenbrock", "dopri5"])
def test_a_name_that_is_taken_is_refused(no_more_methods, name):
    with pytest.raises(ValueError, match=f"expected one that no method has.*{name}"):
        add_method(name, DOP853)


def wrong(values, place, by=1e-6):
    """Return a tuple one of whose numbers is slightly wrong."""
    return tuple(one + by if k == place else one for k, one in enumerate(values))


@pytest.mark.parametrize("tableau", [DOPRI5, DOP853])
@pytest.mark.parametrize("field", ["nodes", "stages", "weights", "errors", "dense"])
def test_a_slip_of_the_pen_is_named(tableau, field):
    check_tableau(tableau)
    values = getattr(tableau, field)
    if field in ("nodes", "weights"):
        changed = wrong(values, 2)
    else:
        changed = (wrong(values[0], 0), *values[1:])
    named = {"nodes": "stages"}.get(field, field)
    with pytest.raises(ValueError, match=rf"^{named}.*: expected the sum"):
        check_tableau(replace(tableau, **{field: changed}))


def test_a_missing_number_is_named():
    short = replace(
        DOPRI5, stages=(DOPRI5.stages[0], DOPRI5.stages[1][:1], *DOPRI5.stages[2:])
    )
    with pytest.raises(ValueError, match="stages: expected rows of 1, 2, "):
        check_tableau(short)
    with pytest.raises(ValueError, match="nodes: expected one for each of stages"):
        check_tableau(replace(DOPRI5, nodes=DOPRI5.nodes[:-1]))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"order": 5.5}, "order: expected a whole number from 1"),
        ({"errors": ()}, "errors: expected one row or two, found 0"),
        (
            {"errors": ((1.0, -1.0, *6 * (0.0,)),)},
            r"errors\[0\]: expected at most 7 weights, found 8",
        ),
        ({"dense": 5 * ((1.0, -1.0),)}, "dense: expected at most 4 rows, found 5"),
        ({"dense": ((1.0, -1.0, *6 * (0.0,)),)}, r"dense\[0\]: expected at most 7"),
        (
            {"dense_nodes": (0.5,), "dense_stages": ((0.5, *7 * (0.0,)),)},
            r"dense_stages\[0\]: expected at most 7 weights, found 8",
        ),
    ],
)
def test_weights_of_slopes_that_are_not_there_are_refused(changed, said):
    with pytest.raises(ValueError, match=said):
        check_tableau(replace(DOPRI5, **changed))


def test_without_dense_the_interpolant_is_the_cubic():
    ralston = Tableau(
        order=2, nodes=(2 / 3,), stages=((2 / 3,),), weights=(1 / 4, 3 / 4),
        errors=((-3 / 4, 3 / 4),), dense_error=1, stiff_tenths=18,
    )  # fmt: skip
    check_tableau(ralston)
    assert ralston.degree == 3
