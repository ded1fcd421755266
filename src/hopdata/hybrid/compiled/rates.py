"""Rates of guards that return only their values.

`with_rates` makes the integrator's own form of guards from a function that fills `h`.
Where it cannot be evaluated with derivatives, its rates come from a central difference
along the direction in which the state moves.
"""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

import numba
import numpy as np

from hopdata.arrays import FloatArray
from hopdata.hybrid.compiled.digest import with_digest
from hopdata.hybrid.compiled.helpers import with_helpers, within

Function = Callable[..., Any]

#: Increment of time for a difference, as a fraction of the time in which the state
#: moves by its own size.
#: Unit: 1. Origin: derived: the cube root of the rounding, for which the rounding error
#: of a central difference equals its truncation error.
INCREMENT = (2.0**-52) ** (1.0 / 3.0)


def increment(t: float, y: FloatArray, dy: FloatArray) -> float:
    """Return the increment of time for a difference.

    Parameters
    ----------
    t : float
        Time, s.
    y, dy : (n,) array
        State, and the direction in which it moves.
    """
    size = 0.0
    speed = 0.0
    for i in range(len(y)):
        size = max(size, abs(y[i]))
        speed = max(speed, abs(dy[i]))
    if size > 0.0 and speed > 0.0:
        return float(INCREMENT * size / speed)
    return INCREMENT * max(abs(t), 1.0)


BY_DIFFERENCES = """
def {name}(t, y, dy, mode, params, h, hdot):
    step = increment(t, y, dy)
    moved = np.empty(len(y))
    ahead = np.empty(len(h))
    for i in range(len(y)):
        moved[i] = y[i] + step * dy[i]
    VALUES(t + step, moved, mode, params, ahead)
    for i in range(len(y)):
        moved[i] = y[i] - step * dy[i]
    VALUES(t - step, moved, mode, params, h)
    for k in range(len(h)):
        hdot[k] = (ahead[k] - h[k]) / (2.0 * step)
    VALUES(t, y, mode, params, h)
"""
VALUES_ONLY = """
def {name}(t, y, dy, mode, params, h, hdot):
    VALUES(t, y, mode, params, h)
"""


def with_rates(values: Function, exact: Function | None) -> FunctionType:
    """Return guards of the integrator's own form for compiled code.

    Parameters
    ----------
    values : FunctionType
        Takes ``t, y, mode, params, h`` and fills `h`.
    exact : callable, optional
        Makes guards with exact rates from a function for compiled code, though they may
        not compile. By default the rates are differences.
    """
    assert isinstance(values, FunctionType)
    if exact is None:
        return _composed(values, BY_DIFFERENCES)
    made: FunctionType = exact(_dispatcher(values))
    made.__code__ = made.__code__.replace(co_filename=values.__code__.co_filename)
    made.__module__ = values.__module__
    return made


def values_only(values: Function) -> FunctionType:
    """Return guards of the integrator's own form that leave `hdot` as it is."""
    assert isinstance(values, FunctionType)
    return _composed(values, VALUES_ONLY)


def _dispatcher(values: FunctionType) -> Any:
    return within(with_digest(with_helpers(values)))


def _composed(values: FunctionType, template: str) -> FunctionType:
    name = values.__name__
    if not name.isidentifier():
        name = "guards"
    names: dict[str, Any] = {
        "__name__": values.__module__,
        "np": np,
        "increment": numba.njit(increment),
        "VALUES": _dispatcher(values),
    }
    code = compile(template.format(name=name), values.__code__.co_filename, "exec")
    exec(code, names)
    made: FunctionType = names[name]
    return made


def rates_in_python(
    values: Function,
    t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: Any,
    params: FloatArray,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Fill `h` and `hdot` by a function that Python runs."""
    step = increment(t, y, dy)
    ahead = np.empty_like(h)
    behind = np.empty_like(h)
    values(t + step, y + step * dy, mode, params, ahead)
    values(t - step, y - step * dy, mode, params, behind)
    hdot[:] = (ahead - behind) / (2.0 * step)
    values(t, y, mode, params, h)
