"""The methods that a user can choose from, and the table of them that the driver reads.

There is machine code of two kinds for an explicit method: generic code, the same for all scenes
(see `generic`), which is there at once, and code made for the scene, which is faster and takes a
second or two to compile. Results have the same bytes. A scene begins with its own code where that
is in the cache, with generic code where it is not; its own is made when the scene has taken
`WORTH_COMPILING` steps in this process, or a batch will take so many, or the caller asks for it.
"""

from __future__ import annotations

import difflib
from typing import Any

import numpy as np

from hopdata.hybrid.driver import layout
from hopdata.hybrid.driver.layout import FloatArray, IntArray
from hopdata.hybrid.methods import rosenbrock, stiffness, taylor
from hopdata.hybrid.methods.dop853 import DOP853
from hopdata.hybrid.methods.dopri5 import DOPRI5
from hopdata.hybrid.methods.generic import generic_interpolant, generic_step
from hopdata.hybrid.methods.method import (
    Method,
    compiled_interpolant,
    compiled_refresh,
    compiled_step,
    compiled_tangent,
    is_compiled,
)
from hopdata.hybrid.methods.scene import Scene, explicit, rosenbrock_method, taylor_method

TABLEAUS = {"dopri5": DOPRI5, "dop853": DOP853}
MAKERS = {
    "dopri5": lambda scene: explicit(DOPRI5, scene),
    "dop853": lambda scene: explicit(DOP853, scene),
    "taylor": taylor_method,
    "rosenbrock": rosenbrock_method,
}
CHOICES = ("auto", *MAKERS)
AUTOMATIC = ("dopri5", "dop853", "rosenbrock")  # from cheap to high order, then stiff
LARGEST_STIFF = 200  # states; above, the matrices of Rosenbrock would not be worth their memory
# Steps in a process, from which a scene gets code of its own: that takes 0.4 to 2.5 s, saves 0.02
# to 0.07 us of each step, and is there for the next process.
WORTH_COMPILING = 5_000_000
STIFF_LIMITS = {"dopri5": stiffness.DOPRI5_LIMIT, "dop853": stiffness.DOP853_LIMIT}


def check_method(name: str, scene: Scene, jacobian: bool) -> tuple[str, ...]:
    """Return the names of the methods that a choice allows the driver to take.

    Raises
    ------
    ValueError
        If there is no method of this name, or it does not suit the scene.
    """
    if not isinstance(name, str) or name not in CHOICES:
        near = difflib.get_close_matches(str(name), CHOICES, n=1)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        raise ValueError(f"method: expected one of {', '.join(CHOICES)}, found {name!r}{hint}")
    if name == "taylor" and scene.affine is None:
        raise ValueError("method: 'taylor' expects a System with an @affine function, found none")
    if name == "rosenbrock" and jacobian:
        raise ValueError("jacobian: expected an explicit method or 'taylor', found 'rosenbrock'")
    if name != "auto":
        return (name,)
    if scene.affine is not None:
        return ("taylor",)
    with_stiff = not jacobian and scene.n_states <= LARGEST_STIFF
    return AUTOMATIC if with_stiff else AUTOMATIC[:-1]


def work_rows(names: tuple[str, ...], n_states: int) -> int:
    """Return the number of work rows that these methods need."""
    needed = {
        "dopri5": DOPRI5.work_rows,
        "dop853": DOP853.work_rows,
        "taylor": taylor.work_rows(n_states),
        "rosenbrock": rosenbrock.work_rows(n_states),
    }
    return max(needed[name] for name in names)


class MethodTable:
    """The methods among which the driver may choose, made ready when it first asks for one.

    Parameters
    ----------
    choice : str
        One of `CHOICES`.
    scene : Scene
        What they are made for.
    jacobian : bool
        Whether the flow's Jacobian is wanted too.

    Attributes
    ----------
    choice : str
        The same.
    generic : set of int
        Methods whose code is generic now, by their numbers.
    steps : int
        Steps of the integrations that have ended, counted by the caller while there are any.
    scene : Scene
        What they are made for.
    """

    def __init__(self, choice: str, scene: Scene, jacobian: bool) -> None:
        self.choice, self._names = choice, check_method(choice, scene, jacobian)
        self.scene, self._jacobian = scene, jacobian
        self._kept_alive: list[Any] = []
        self._methods: dict[int, Method] = {}
        self.generic: set[int] = set()
        self.steps = 0
        self.work_rows = work_rows(self._names, scene.n_states)
        self.tangent_rows = 0
        self.rows: IntArray = np.zeros((len(self._names), layout.METHOD_SLOTS), dtype=np.int64)
        for number in range(len(self._names)):
            self._describe(number)
        if self._names == ("taylor",):  # the driver refreshes it from the very start
            self.compile(0)

    def _describe(self, number: int) -> None:
        name, row = self._names[number], self.rows[number]
        method = self._methods[number] = MAKERS[name](self.scene)
        row[layout.EVALUATIONS], row[layout.ORDER] = method.evaluations, method.order
        row[layout.INTERPOLANT_EVALUATIONS] = method.interpolant_evaluations
        row[layout.INTERPOLANT_ERROR], row[layout.IN_POWERS] = (
            method.interpolant_error,
            method.in_powers,
        )
        row[layout.LAST_SLOPE], row[layout.DENSER] = method.last_slope_row, -1
        row[[layout.SPARSER, layout.STIFFER, layout.RELAXED]] = -1
        row[layout.STIFF_TENTHS] = round(10 * STIFF_LIMITS.get(name, 0.0))
        self.tangent_rows = max(self.tangent_rows, method.tangent_rows)
        row[layout.TANGENT_EVALUATIONS] = method.tangent_evaluations
        row[layout.SHORT_TANGENT_EVALUATIONS] = method.short_tangent_evaluations
        if len(self._names) > 1:
            self._chain(number, row)

    def _chain(self, number: int, row: IntArray) -> None:
        """Say which method follows which, among those of an automatic choice."""
        last = len(self._names) - 1
        has_stiff = self._names[last] == "rosenbrock"
        highest = last - 1 if has_stiff else last
        if has_stiff and number == last:
            row[layout.RELAXED] = highest
            return
        row[layout.SPARSER] = number + 1 if number < highest else -1
        row[layout.DENSER] = number - 1
        row[layout.STIFFER] = last if has_stiff else -1

    def provide(self, number: int) -> None:
        """Make a method ready, which the driver has asked for."""
        if self._generic_will_do(number):
            tableau = TABLEAUS[self._names[number]]
            self._enter(number, generic_step(tableau), generic_interpolant(tableau))
            self.generic.add(number)
        else:
            self.compile(number)

    def _generic_will_do(self, number: int) -> bool:
        if self._names[number] not in TABLEAUS or self._jacobian:
            return False
        if not self.scene.field.compiled:
            return True
        few = self.steps < WORTH_COMPILING
        return few and not is_compiled(self._methods[number], self.scene.n_states)

    def wants_own_code(self, steps: int = 0) -> bool:
        """Tell whether, with these steps more, so many are taken that the scene wants its code."""
        return self.steps + steps >= WORTH_COMPILING and self.scene.field.compiled

    def specialise(self, steps: int = 0) -> None:
        """Compile for the scene what is generic, if with these steps more it has taken many."""
        if self.generic and self.wants_own_code(steps):
            generic, self.generic = self.generic, set()
            for number in generic:
                self.compile(number)

    def compile_all(self) -> None:
        """Compile all methods for the scene, as far as its field is compiled."""
        make = self.compile if self.scene.field.compiled else self.provide
        generic, self.generic = self.generic, set()
        for number in range(len(self._names)):
            if number in generic or self.rows[number, layout.STEP] == 0:
                make(number)

    def _enter(self, number: int, step: Any, interpolant: Any) -> None:
        """Hand machine code to the driver."""
        self._kept_alive += [step, interpolant]
        row = self.rows[number]
        row[layout.INTERPOLANT], row[layout.STEP] = interpolant.address, step.address

    def _compile_tangent(self, number: int, slot: int, tangent: Any) -> None:
        if tangent is not None:
            scene = self.scene
            compiled = compiled_tangent(tangent, scene.n_states, cache=scene.cacheable)
            self._kept_alive.append(compiled)
            self.rows[number][slot] = compiled.address

    def compile(self, number: int) -> None:
        """Make the machine code of a method for the scene."""
        method, row = self._methods[number], self.rows[number]
        n_states, cache = self.scene.n_states, self.scene.cacheable
        if method.refresh is not None:
            refresh = compiled_refresh(method, n_states, cache=cache)
            self._kept_alive.append(refresh)
            row[layout.REFRESH] = refresh.address
        if self._jacobian:
            self._compile_tangent(number, layout.TANGENT, method.tangent)
            self._compile_tangent(number, layout.SHORT_TANGENT, method.short_tangent)
        step = compiled_step(method, n_states, cache=cache)
        self._enter(number, step, compiled_interpolant(method, n_states, cache=cache))


def tangent_table(methods: MethodTable, n_states: int) -> FloatArray:
    """Return room for the flow's Jacobian, which begins as the identity."""
    table = np.zeros((methods.tangent_rows, n_states))
    np.fill_diagonal(table[:n_states], 1.0)
    table[3 * n_states + layout.RATE_INPUTS, list(methods.scene.rate_inputs)] = 1.0
    table[3 * n_states + layout.STEADY] = methods.scene.steady
    return table
