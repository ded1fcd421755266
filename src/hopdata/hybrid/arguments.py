"""Check what the caller asks for, once, before anything is compiled or run."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.hybrid.system import System

FloatArray = NDArray[np.float64]

SMALLEST_RTOL = 10 * 2.0**-52  # below it, rounding is taken for error


@dataclass(frozen=True)
class Request:
    """Checked arguments of an integration, as the driver takes them."""

    t_start: float
    t_end: float
    y0: FloatArray
    params: FloatArray
    mode: NDArray[np.int64]
    rtol: float
    atol: FloatArray
    max_step: float
    first_step: float  # 0 to have it chosen
    t_eval: FloatArray | None
    max_steps: int
    max_events: int


def check(
    system: System,
    t_span: tuple[float, float],
    y0: ArrayLike,
    *,
    params: ArrayLike,
    mode: Any,
    rtol: float,
    atol: ArrayLike,
    max_step: float,
    first_step: float | None,
    t_eval: ArrayLike | None,
    max_steps: int,
    max_events: int,
) -> Request:
    """Return the checked arguments of `hopdata.hybrid.solve`; raise ValueError if one is wrong."""
    t_start, t_end = (float(t) for t in t_span)
    if not (-inf < t_start <= t_end < inf):
        raise ValueError(f"t_span: expected finite times, the end not first, found {t_span}")
    if not max_step > 0 or not (first_step is None or first_step > 0):
        raise ValueError(f"max_step, first_step: expected > 0, found {max_step}, {first_step}")
    if max_steps < 1 or max_events < 1:
        raise ValueError(f"max_steps, max_events: expected > 0, found {max_steps}, {max_events}")
    return Request(
        t_start=t_start,
        t_end=t_end,
        y0=_state("y0", y0, system.n_states),
        params=np.ascontiguousarray(params, dtype=np.float64).ravel(),
        mode=_mode(system, mode),
        rtol=_relative(rtol),
        atol=_absolute(atol, system.n_states),
        max_step=float(max_step),
        first_step=0.0 if first_step is None else float(first_step),
        t_eval=None if t_eval is None else _times(t_eval, t_start, t_end),
        max_steps=int(max_steps),
        max_events=int(max_events),
    )


def _state(name: str, value: ArrayLike, n_states: int) -> FloatArray:
    state = np.array(value, dtype=np.float64, ndmin=1)
    if state.shape != (n_states,):
        raise ValueError(f"{name}: expected shape ({n_states},), found {state.shape}")
    if not np.isfinite(state).all():
        raise ValueError(f"{name}: expected finite numbers, found {state}")
    return state


def _mode(system: System, mode: Any) -> NDArray[np.int64]:
    full = np.zeros(system.n_modes, dtype=np.int64)
    if mode is None:
        return full
    given = np.array(mode, dtype=np.int64).ravel()
    if len(given) == system.n_modes:
        full[:] = given
    elif len(given) == system.n_extra_modes:
        full[system.n_guards :] = given
    else:
        raise ValueError(
            f"mode: expected {system.n_modes} integers (locks and the scene's own) or "
            f"{system.n_extra_modes} (the scene's own), found {len(given)}"
        )
    if (np.abs(full[: system.n_guards]) > 1).any():
        raise ValueError(f"mode: expected locks -1, +1, or 0 to have them decided, found {given}")
    return full


def _relative(rtol: float) -> float:
    if not 0 <= rtol < 1:
        raise ValueError(f"rtol: expected a number in [0, 1), found {rtol}")
    return max(float(rtol), SMALLEST_RTOL)


def _absolute(atol: ArrayLike, n_states: int) -> FloatArray:
    given = np.asarray(atol, dtype=np.float64)
    if given.shape not in ((), (n_states,)) or not (given >= 0).all():
        raise ValueError(f"atol: expected a number or {n_states} numbers, >= 0, found {atol!r}")
    return given.copy() if given.ndim else np.full(n_states, float(given))


def _times(t_eval: ArrayLike, t_start: float, t_end: float) -> FloatArray:
    times = np.array(t_eval, dtype=np.float64, ndmin=1)
    inside = (times >= t_start) & (times <= t_end)
    if times.ndim != 1 or not inside.all() or not (np.diff(times) > 0).all():
        raise ValueError(f"t_eval: expected increasing times within {(t_start, t_end)}")
    return times
