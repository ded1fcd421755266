"""Programs for SciPy run with this package, with no other change than their import."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import _ivp

from hopdata.hybrid import OdeResult, SlowCallbackWarning

SCIPYS = "from scipy.integrate import solve_ivp"
OURS = "from hopdata.hybrid import solve_ivp"
PROGRAMS = sorted(
    path for path in Path(__file__).parent.glob("*.py") if path.stem[:4] != "test"
)
#: Each compiles for 1 to 3 s: every other one, or with `ALL=1` all of them.
SOME_PROGRAMS = PROGRAMS if "ALL" in os.environ else PROGRAMS[::2]
# Both err by their tolerances; the programs ask for 1e-8 and less, or are exact.
AGREE = 2e-5


def run(path, source):
    """Return the names of a program after its run; none of its functions is slow."""
    names = {"__name__": path.stem}
    with warnings.catch_warnings():
        warnings.simplefilter("error", SlowCallbackWarning)
        exec(compile(source, str(path), "exec"), names)
    return names


def agree(one, other, what):
    one, other = np.asarray(one, float), np.asarray(other, float)
    assert one.shape == other.shape, what
    scale = np.max(np.abs(one), initial=1e-3)
    assert np.max(np.abs(one - other), initial=0.0) <= AGREE * scale, what


def same_results(theirs, ours, name):
    """Compare all fields of two results."""
    expected = {"t", "y", "sol", "t_events", "y_events", "nfev", "njev", "nlu"}
    expected |= {"status", "message", "success"}
    assert expected <= set(theirs) & set(ours), name
    assert (theirs.status, theirs.success) == (ours.status, ours.success), name
    agree(theirs.t[-1], ours.t[-1], f"{name}.t[-1]")
    agree(theirs.y[:, -1], ours.y[:, -1], f"{name}.y[:, -1]")
    if len(theirs.t) == len(ours.t) and np.allclose(theirs.t, ours.t):
        agree(theirs.y, ours.y, f"{name}.y")
    assert (theirs.t_events is None) == (ours.t_events is None), name
    for field in ("t_events", "y_events"):
        pairs = zip(theirs[field] or (), ours[field] or (), strict=True)
        for k, (one, other) in enumerate(pairs):
            if len(one) or len(other):
                agree(one, other, f"{name}.{field}[{k}]")
    if theirs.sol is not None:
        times = np.linspace(theirs.t[0], min(theirs.t[-1], ours.t[-1]), 50)
        agree(theirs.sol(times), ours.sol(times), f"{name}.sol")


def test_there_are_ten():
    assert len(PROGRAMS) >= 10


@pytest.mark.parametrize("path", SOME_PROGRAMS, ids=lambda path: path.stem)
def test_only_the_import_changes(path):
    source = path.read_text("utf-8")
    assert source.count(SCIPYS) == 1
    theirs = run(path, source)
    ours = run(path, source.replace(SCIPYS, OURS))
    compared = 0
    for name, value in theirs.items():
        if isinstance(value, _ivp.ivp.OdeResult):
            assert isinstance(ours[name], OdeResult)
            same_results(value, ours[name], name)
            compared += 1
        elif isinstance(value, np.ndarray):
            agree(value, ours[name], name)
            compared += 1
    assert compared > 0
