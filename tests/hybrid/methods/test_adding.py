"""A method that a user adds: the page's example, and coefficients that do not fit."""

from __future__ import annotations

from dataclasses import replace

import pytest
from pages import run_page

from hopdata.hybrid.methods import table
from hopdata.hybrid.methods.explicit import DOP853, DOPRI5, check_tableau
from hopdata.hybrid.methods.table import add_method, choices


@pytest.fixture
def no_more_methods(monkeypatch):
    monkeypatch.setattr(table, "TABLEAUS", dict(table.TABLEAUS))


def test_the_page_adds_a_method(no_more_methods, capsys):
    run_page("integrator_method")
    assert "tsit5" in choices()
    with pytest.raises(ValueError, match="name: expected one that no method has"):
        add_method("tsit5", DOPRI5)


@pytest.mark.parametrize("name", ["auto", "rosenbrock", "dopri5"])
def test_a_name_that_is_taken_is_refused(no_more_methods, name):
    with pytest.raises(ValueError, match=f"expected one that no method has.*{name}"):
        add_method(name, DOPRI5)


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
