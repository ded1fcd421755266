"""The methods that a user can choose, and the table of them that the driver reads.

An explicit method has machine code of two kinds. Generic code (`generic_code`) is the
same for all scenes and available at once. Code made for the scene is faster and takes a
second or two to compile. Results have the same bytes. A scene starts with its own code
if that is in the cache, and otherwise with generic code. Its own code is then made once
generic code has run for `WORTH_COMPILING` in this process, a batch is going to take
that long, or the caller requests it. It is compiled at once, by the caller's thread:
beside another one that compiles, short solves are a third as fast, because both need
Python's lock, and a fork meanwhile would inherit the compiler's.
"""

from functools import cache, lru_cache
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import did_you_mean
from hopdata.hybrid import layout
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.compiled.declare import reason_and_advice
from hopdata.hybrid.compiled.kernel import PARTS
from hopdata.hybrid.methods import method as made
from hopdata.hybrid.methods import stiff
from hopdata.hybrid.methods.explicit import (
    DOP853,
    DOPRI5,
    Tableau,
    check_tableau,
)
from hopdata.hybrid.methods.method import Method, Scene, compiled_part

TABLEAUS = {"dopri5": DOPRI5, "dop853": DOP853}
MAKERS = {"taylor": made.taylor_method, "rosenbrock": made.rosenbrock_method}
TANGENTS = ("tangent", "short_tangent")
AUTOMATIC = ("dopri5", "dop853", "rosenbrock")  # from cheap to high order, then stiff

#: Most states for which "auto" may take the Rosenbrock method with a full matrix: with
#: more, its matrices would need too much memory.
#: Unit: 1. Origin: chosen.
LARGEST_STIFF = 200

#: Time for which a scene's generic code runs in a process before the scene gets its
#: own. Compiling takes 0.5 to 2 s and saves 13 to 29 % of the time from then on (seven
#: small systems): it is won back within 4 to 12 s, in this process or in later ones,
#: which load the code.
#: Unit: s. Origin: chosen.
WORTH_COMPILING = 1.0

# Attributes of a method that the driver's table holds, in columns of these names.
COLUMNS = (
    "evaluations",
    "interpolant_evaluations",
    "tangent_evaluations",
    "short_evaluations",
    "order",
    "interpolant_error",
    "in_powers",
    "last_slope",
    "stiff_tenths",
)


def choices() -> tuple[str, ...]:
    """Return the names by which a method can be chosen."""
    return ("auto", *TABLEAUS, *MAKERS)


def add_method(name: str, tableau: Tableau) -> None:
    """Let ``method=name`` choose an explicit Runge-Kutta pair, in this process.

    Its machine code, its interpolant, the proof along it, and its derivatives follow
    from the coefficients. ``"auto"`` does not take it.

    Parameters
    ----------
    name : str
        A name that no method has yet; or that of an equal method, as where a cell of a
        notebook runs again.
    tableau : Tableau
        Coefficients of the pair and of its interpolant.

    Raises
    ------
    ValueError
        If the name is taken, or the coefficients are not those of a method.
    """
    is_new = isinstance(name, str) and name not in choices()
    is_same = isinstance(name, str) and TABLEAUS.get(name) == tableau
    expect(is_new or is_same, "name", "one that no method has", repr(name))
    check_tableau(tableau)
    TABLEAUS[name] = tableau


@cache
def generic_code(name: str, tangents: bool = False) -> dict[str, Any]:
    """Return an explicit method's machine code for any scene, compiled once."""
    method = made.explicit_method(TABLEAUS[name])
    parts = TANGENTS if tangents else ("interpolant", "step")
    return {
        part: compiled_part(part, method, 0) for part in parts if getattr(method, part)
    }


@lru_cache(made.KEPT)
def method_for(name: str, scene: Scene) -> Method:
    """Return a method for a scene; systems with the same functions share it."""
    if name in MAKERS:
        return MAKERS[name](scene)
    return made.explicit_method(TABLEAUS[name], scene)


def check_method(name: str, scene: Scene, jacobian: bool) -> tuple[str, ...]:
    """Return the names of the methods among which the driver may choose.

    Raises
    ------
    ValueError
        If no method has this name, or if it does not suit the scene.
    """
    known = isinstance(name, str) and name in choices()
    hint = "" if known else did_you_mean(str(name), choices())
    expect(known, "method", f"one of {', '.join(choices())}", repr(name), hint)
    suits = name != "taylor" or scene.affine is not None
    expect(suits, "method", "a System with an @affine function for 'taylor'", "none")
    carries = name != "rosenbrock" or not jacobian
    expect(carries, "jacobian", "an explicit method or 'taylor'", repr(name))
    if name != "auto":
        return (name,)
    if scene.affine is not None:
        return ("taylor",)
    dense = scene.sparsity is None
    if jacobian or (dense and scene.n_states > LARGEST_STIFF):
        return tuple(name for name in AUTOMATIC if name in TABLEAUS)
    return AUTOMATIC


class MethodTable:
    """The methods among which the driver may choose; each is made ready on first use.

    Parameters
    ----------
    choice : str
        One of `choices`.
    scene : Scene
        Scene for which the methods are made.
    jacobian : bool
        Whether the flow's Jacobian is wanted, too.

    Attributes
    ----------
    choice : str
        Choice of methods.
    generic : set of int
        Numbers of the methods whose code is generic at present.
    seconds : float
        Time spent in the driver while any method is generic, s, counted by the caller.
    scene : Scene
        Scene for which the methods are made.
    degree : int
        Highest degree of the interpolants.
    pattern : Pattern or None
        Pattern of a sparse Jacobian, if one of the methods uses it.
    unchecked : bool
        Whether the field must still be compared with it.
    by_differences : str
        Why an implicit method takes differences of the field, if it does.
    """

    def __init__(self, choice: str, scene: Scene, jacobian: bool) -> None:
        self.choice = choice
        self._names = check_method(choice, scene, jacobian)
        self.scene = scene
        self._jacobian = jacobian
        # Whether a Jacobian takes the field's own derivative.
        explicit = any(name in TABLEAUS for name in self._names)
        self.by_field = explicit and scene.jacobian is None
        self._kept_alive: list[Any] = []
        self._methods = [method_for(name, scene) for name in self._names]
        self.pattern = scene.sparsity if "rosenbrock" in self._names else None
        self.unchecked = self.pattern is not None and not self.pattern.is_proven
        self.by_differences = ""
        self.generic: set[int] = set()
        self.seconds = 0.0
        self.work_rows = max(method.work_rows for method in self._methods)
        enclosed_at = layout.P0 + layout.LOW_DEGREE + 1
        self.tangent_rows = max(method.tangent_rows for method in self._methods)
        self.degree = DOP853.degree
        if "taylor" in self._names:
            self.degree = layout.LARGEST_DEGREE
            enclosed_at = layout.W1 + self.work_rows
            # Its interpolant is in powers already.
            self.work_rows += 2 * (self.degree + 1)
        shape = (len(self._names), layout.METHOD_SLOTS)
        self.rows: IntArray = np.zeros(shape, dtype=np.int64)
        self.rows[:, layout.ENCLOSED_AT] = enclosed_at
        for number, method in enumerate(self._methods):
            self._describe(number, method)
        if self._names == ("taylor",):  # the driver calls its refresh from the start
            self.compile(0)

    @property
    def structure_address(self) -> int:
        """Address of the structure of a sparse Jacobian, 0 if there is none."""
        if self.pattern is None:
            return 0
        return self.pattern.structure.address_for(int(stiff.JAC))

    def check_pattern(
        self,
        t: float,
        y: FloatArray,
        mode: IntArray,
        n_guards: int,
        params: FloatArray,
    ) -> None:
        """Raise an error if the field depends on a state outside the pattern."""
        from hopdata.hybrid.methods.pattern_check import check_pattern

        assert self.pattern is not None
        check_pattern(self.scene.field, self.pattern, t, y, mode, n_guards, params)
        self.unchecked = False

    def _describe(self, number: int, method: Method) -> None:
        """Fill a method's row: its attributes, and the methods to change to."""
        row = self.rows[number]
        for name in COLUMNS:
            row[getattr(layout, name.upper())] = getattr(method, name)
        row[[layout.SPARSER, layout.DENSER, layout.STIFFER, layout.RELAXED]] = -1
        # The explicit methods come first, by their order; one for stiff modes follows.
        highest = sum(name in TABLEAUS for name in self._names) - 1
        implicit = highest + 1
        if number > highest:
            row[layout.RELAXED] = highest
            return
        row[layout.DENSER] = number - 1
        if number < highest:
            row[layout.SPARSER] = number + 1
        if implicit < len(self._names):
            row[layout.STIFFER] = implicit

    def provide(self, number: int) -> None:
        """Make the method ready that the driver has asked for."""
        if self._generic_will_do(number):
            self._enter_tangents(number)
            self._enter(number, generic_code(self._names[number]))
            self.generic.add(number)
        else:
            self.compile(number)

    def _generic_will_do(self, number: int) -> bool:
        """Return whether generic code is the best choice for a method at present."""
        if self._names[number] not in TABLEAUS:
            return False
        if not self.scene.field.compiled:
            return True
        if self.seconds >= WORTH_COMPILING:
            return False
        return not made.is_compiled(self._methods[number], self.scene.n_states)

    def wants_own_code(self, seconds: float = 0.0) -> bool:
        """Return whether the time spent, with `seconds` more, warrants own code."""
        return self.seconds + seconds >= WORTH_COMPILING and self.scene.field.compiled

    def specialise(self, seconds: float = 0.0) -> None:
        """Compile generic methods for the scene if the time spent warrants it.

        `seconds` are about to be added to this time.
        """
        if self.generic and self.wants_own_code(seconds):
            generic = self.generic
            self.generic = set()
            for number in generic:
                self.compile(number)

    def compile_all(self) -> None:
        """Compile all methods for the scene.

        If its field cannot be compiled, they are provided as generic code.
        """
        make = self.compile if self.scene.field.compiled else self.provide
        generic = self.generic
        self.generic = set()
        for number in range(len(self._names)):
            if number in generic or self.rows[number, layout.STEP] == 0:
                make(number)

    def _enter(self, number: int, parts: dict[str, Any]) -> None:
        """Give machine code to the driver.

        The step comes last: it tells other threads that the method is ready.
        """
        for part, code in parts.items():
            self._kept_alive.append(code)
            self.rows[number, getattr(layout, part.upper())] = code.address

    def _enter_tangents(self, number: int) -> None:
        """Give an explicit method's generic tangents to the driver.

        The user's derivative is given with them.
        """
        if self._jacobian and self._names[number] in TABLEAUS:
            self._enter(number, generic_code(self._names[number], tangents=True))
            given = self.scene.dense_jacobian
            if given is not None:
                self.rows[number, layout.DERIVATIVE] = given.address

    def compile(self, number: int) -> None:
        """Compile a method for the scene."""
        method = self._methods[number]
        n_states = self.scene.n_states
        kept = self.scene.cacheable
        self._enter_tangents(number)
        own_tangents = self._jacobian and self._names[number] not in TABLEAUS
        for part in PARTS:
            if part in TANGENTS and not own_tangents:
                continue
            if getattr(method, part) is None:
                continue
            try:
                code = compiled_part(part, method, n_states, cache=kept)
            # Numba's own exceptions, and others raised within it.
            except Exception as error:
                if method.otherwise is None:
                    raise
                users = self.scene.field.users
                self.by_differences = (
                    f"field, of the stiff method: {reason_and_advice(error, users)[0]}"
                )
                method = method.otherwise
                self._methods[number] = method
                self._describe(number, method)
                code = compiled_part(part, method, n_states, cache=kept)
            self._enter(number, {part: code})
