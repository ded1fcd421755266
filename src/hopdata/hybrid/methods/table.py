"""The methods that a user can choose from, and the table of them that the driver reads."""

from __future__ import annotations

import difflib
from typing import Any

import numpy as np

from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.driver import layout
from hopdata.hybrid.driver.layout import IntArray
from hopdata.hybrid.methods.dop853 import DOP853
from hopdata.hybrid.methods.dopri5 import DOPRI5
from hopdata.hybrid.methods.explicit import explicit_method
from hopdata.hybrid.methods.method import Method, compiled_interpolant, compiled_step

CHOICES: dict[str, tuple[str, ...]] = {
    "auto": ("dopri5", "dop853"),
    "dopri5": ("dopri5",),
    "dop853": ("dop853",),
}
WORK_ROWS = max(DOPRI5.work_rows, DOP853.work_rows)


def check_method(name: str) -> None:
    """Raise ValueError if there is no method of this name."""
    if name not in CHOICES:
        near = difflib.get_close_matches(str(name), CHOICES, n=1)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        raise ValueError(f"method: expected one of {', '.join(CHOICES)}, found {name!r}{hint}")


class MethodTable:
    """The methods among which the driver may choose, compiled when it first asks for one.

    Parameters
    ----------
    choice : str
        A key of `CHOICES`.
    field : Callback
        The vector field.
    n_states : int
        Length of the state.
    """

    def __init__(self, choice: str, field: Callback, n_states: int) -> None:
        self._names, self._field, self._n_states = CHOICES[choice], field, n_states
        self._kept_alive: list[Any] = []
        self.rows: IntArray = np.zeros((len(self._names), layout.METHOD_SLOTS), dtype=np.int64)
        for k in range(len(self._names)):
            self._describe(k)

    def _method(self, number: int) -> Method:
        tableau = {"dopri5": DOPRI5, "dop853": DOP853}[self._names[number]]
        return explicit_method(tableau, self._field.dispatcher, self._n_states)

    def _describe(self, number: int) -> None:
        method, row = self._method(number), self.rows[number]
        row[layout.EVALUATIONS], row[layout.ORDER] = method.evaluations, method.order
        row[layout.DEGREE], row[layout.IN_POWERS] = method.degree, method.in_powers
        row[[layout.SPARSER, layout.DENSER, layout.STIFFER]] = -1
        if self._names == CHOICES["auto"]:
            row[layout.SPARSER if number == 0 else layout.DENSER] = 1 - number

    def compile(self, number: int) -> None:
        """Make the machine code of a method, which the driver has asked for."""
        method = self._method(number)
        step = compiled_step(method, self._n_states, cache=self._field.compiled)
        interpolant = compiled_interpolant(method, self._n_states, cache=self._field.compiled)
        self._kept_alive += [step, interpolant]
        self.rows[number, layout.INTERPOLANT] = interpolant.address
        self.rows[number, layout.STEP] = step.address
