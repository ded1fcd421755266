"""Lanes know the functions that the page on the integrator lists, and no others."""

from __future__ import annotations

import linecache
import math
import re

import numpy as np
from pages import DOCS

from hopdata.hybrid import System, solve_batch

PAGE = (DOCS / "integrator_many.md").read_text(encoding="utf-8")
NUMPYS = {name: f"arc{name[1:]}" for name in ("asin", "acos", "atan", "asinh", "acosh")}
NUMPYS |= {"atanh": "arctanh", "atan2": "arctan2"}
OF_TWO = ("min", "max", "minimum", "maximum", "mod", "hypot", "atan2")


def listed(begin, end):
    """Return the names in backticks, or in a block, between two texts of the page."""
    found = re.search(f"{re.escape(begin)}(.*?){re.escape(end)}", PAGE, re.DOTALL)
    block = re.search("```(.*?)```", found[1], re.DOTALL)
    if block:
        return block[1].split()
    return re.findall("`([a-z0-9]+)`", found[1])


def calls(name):
    """Yield calls of a function, as users write them, at x and z of states."""
    if name == "where":
        yield "np.where(x < z, x, z)"
        return
    if name == "interp":
        yield "np.interp(x, PLACES, VALUES)"
        return
    argument = "1.6 + 0.3 * z" if name == "acosh" else "0.3 * x"
    if name in ("sqrt", "log", "log2", "log10"):
        argument = "1.2 + 0.3 * x"
    if name in OF_TWO:
        argument += ", 0.5 + 0.3 * z"
    if name in ("abs", "min", "max"):
        yield f"{name}({argument})"
        if name != "abs":
            return
    numpys = NUMPYS.get(name, name)
    if hasattr(np, numpys):
        yield f"np.{numpys}({argument})"
    else:
        yield f"math.{name}({argument})"


def made(body, name):
    """Return a function of this body, whose source can be read."""
    source = f"def {name}(t, y):\n    x, z = y[0], y[1]\n    return {body}\n"
    file = f"<page {name}>"
    linecache.cache[file] = (len(source), None, source.splitlines(True), file)
    names = {
        "math": math,
        "np": np,
        "PLACES": np.array([-1.0, 0.0, 1.0]),
        "VALUES": np.array([0.5, 0.1, 0.3]),
    }
    exec(compile(source, file, "exec"), names)
    return names[name]


def in_lanes(field, guards=None):
    """Return the batch of some states in lanes, and that of the driver."""
    names = {} if guards is None else {"guard_names": ("h",)}
    system = System(field, guards, n_states=2, **names)
    starts = np.column_stack([np.linspace(-0.9, 0.9, 5), np.linspace(0.9, -0.7, 5)])
    options = {"rtol": 1e-6, "workers": 1, "method": "dop853"}
    return [
        solve_batch(system, (0.0, 0.4), starts, lanes=lanes, **options)
        for lanes in (True, False)
    ]


def test_a_field_of_all_functions_on_the_page_runs_in_lanes():
    names = listed("these functions of `math`", "Slices,")
    assert len(names) > 30
    terms = [call for name in names for call in calls(name)]
    assert len(terms) > 30
    total = " + ".join([*terms, "x**2 + x % 0.7 - z / 2.0"])
    here, there = in_lanes(made(f"0.02 * ({total}), -z", "rates"))
    assert not here.lanes_reason, here.lanes_reason
    assert here.lanes.all()
    np.testing.assert_allclose(here.y_end, there.y_end, rtol=1e-5, atol=1e-7)


def test_guards_of_all_ranges_on_the_page_are_proven_in_lanes():
    names = listed("Ranges in lanes know", "In guards")
    assert {"floor", "hypot", "min", "exp"} <= set(names)
    terms = [call for name in names for call in calls(name)]
    total = " + ".join([*terms, "x**2 + x % 0.7 - z / 2.0"])
    guards = made(f"x + 0.2 + 0.003 * ({total})", "values")
    here, there = in_lanes(made("1.0, -z", "plain_rates"), guards)
    assert not here.lanes_reason, here.lanes_reason
    assert here.proven.all()
    assert here.success
    np.testing.assert_array_equal(here.n_events, there.n_events)
    assert here.n_events.sum() > 0


def test_what_the_page_leaves_to_the_driver_says_its_line():
    for body in ("(y[0:2] * 0.5)[0], x", "int(x) * 1.0, x", "x // 0.5, x"):
        here, there = in_lanes(made(body, "rates_apart"))
        assert "rates_apart" in here.lanes_reason
        assert here.y_end.tobytes() == there.y_end.tobytes()
