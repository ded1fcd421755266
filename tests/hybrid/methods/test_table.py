"""The choice of a method by its name."""

from __future__ import annotations

import pytest
from hybrid_systems import ladder

from hopdata.hybrid import solve, solve_batch
from hopdata.hybrid.methods.table import CHOICES

OPTIONS = {"params": (0.5, 1.0)}


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("dop835", "dop853"), ("dopri", "dopri5"), ("Dopri5", "dopri5"), ("tailor", "taylor"),
        ("rosenbrok", "rosenbrock"), ("atuo", "auto"),
    ],
)  # fmt: skip
def test_a_name_that_is_nearly_right(name, near):
    for call in (solve, solve_batch):
        start = [0.0, 0.0] if call is solve else [[0.0, 0.0]]
        with pytest.raises(ValueError, match=rf"found '{name}'; did you mean '{near}'\?$"):
            call(ladder(1), (0, 1), start, method=name, **OPTIONS)


@pytest.mark.parametrize("name", ["Radau!", "", None, 5])
def test_a_name_like_no_other(name):
    with pytest.raises(ValueError, match=r"method: expected one of auto, ") as caught:
        solve(ladder(1), (0, 1), [0.0, 0.0], method=name, **OPTIONS)
    assert "did you mean" not in str(caught.value)
    assert all(choice in str(caught.value) for choice in CHOICES)


def test_taylor_needs_an_affine_form():
    with pytest.raises(ValueError, match=r"'taylor' expects a System with an @affine function"):
        solve(ladder(1), (0, 1), [0.0, 0.0], method="taylor", **OPTIONS)


def test_an_error_leaves_the_system_usable():
    system = ladder(1)
    with pytest.raises(ValueError, match="method"):
        solve(system, (0, 1), [0.0, 0.0], method="taylor", **OPTIONS)
    assert solve(system, (0, 1), [0.0, 0.0], **OPTIONS).y_end[0] == pytest.approx(1.5)
