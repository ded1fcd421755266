# ruff: noqa: ARG001 (specialised and generic code is called alike)
"""What a method of integration is to the driver, and how its code is made for a scene.

A method is two functions (three with Jacobians), made for a scene so that the scene's field stands
within them and the number of states is a constant: for a small field, calls and loops would cost
more than the evaluations.

    step(t, dt, rtol, s, mode, params, atol) -> error in units of the tolerance
    interpolant(t, dt, s, mode, params) -> its degree

The table s holds state and slope at the start of the step in the rows Y and K1; the step fills END
and KEND with those at its end; the interpolant fills P1 ... (see `driver.dense`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import Any

from numba import cfunc

from hopdata.code_cache import compiled_in_cache, function_digest, is_in_cache
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.digest import driver_digest, with_digest
from hopdata.hybrid.compiled.kernel import (
    ENTRY,
    INTERPOLANT_NATIVE,
    REFRESH_NATIVE,
    STEP_NATIVE,
    TANGENT_NATIVE,
    kernel,
    kernel_in_loop,
)
from hopdata.hybrid.compiled.memory import (
    array_of,
    float_table,
    float_vector,
    int_vector,
    row,
    square,
)
from hopdata.hybrid.layout import PHI_ROWS
from hopdata.hybrid.methods import (
    stiff as differences,
)
from hopdata.hybrid.methods import (
    stiff as rosenbrock,
)
from hopdata.hybrid.methods import (
    tangent,
    taylor,
)
from hopdata.hybrid.methods import (
    tangent as short_tangent,
)
from hopdata.hybrid.methods import (
    taylor as motion,
)
from hopdata.hybrid.methods import (
    taylor as series,
)
from hopdata.hybrid.methods.explicit import TINY, Tableau, compose, interpolant_code, step_code
from hopdata.hybrid.methods.tangent import product_templates

Function = Callable[..., Any]


@dataclass(frozen=True)
class Method:
    """A method, made for a scene.

    Parameters
    ----------
    name : str
        Its name.
    order : int
        Order of the error estimate, by which the step is controlled: the error of a step goes
        with this power of its length.
    evaluations : int
        Field evaluations of a step.
    interpolant_evaluations : int
        Field evaluations of the interpolant.
    interpolant_error : int
        Its error at the middle of a step, in units of the step's estimated error.
    in_powers : bool
        Whether the interpolant is in powers of theta.
    step, interpolant : callable
        The functions, for Numba to compile.
    tangent : callable, optional
        ``tangent(t, dt, rtol, s, mode, params, atol, phi)`` writes the product of the step's
        Jacobian and that in the first rows of phi into the next rows; returns its error in units
        of the tolerance.
    tangent_evaluations : int
        Field evaluations that this takes.
    tangent_rows : int
        Rows of phi that the tangent needs.
    short_tangent : callable, optional
        The same for a short step, along its interpolant (see `methods.short_tangent`).
    short_tangent_evaluations : int
        Field evaluations that this takes.
    refresh : callable, optional
        ``refresh(s, mode, params)`` is called whenever the mode may have changed; returns by how
        much what the method knows of the field differs from it, relatively.
    last_slope_row : int
        Of an explicit method, the row with the slope of its last stage, by which stiffness shows.
    """

    name: str
    order: int
    evaluations: int
    interpolant_evaluations: int
    interpolant_error: int
    in_powers: bool
    step: Function
    interpolant: Function
    tangent: Function | None = None
    tangent_evaluations: int = 0
    tangent_rows: int = 0
    short_tangent: Function | None = None
    short_tangent_evaluations: int = 0
    refresh: Function | None = None
    last_slope_row: int = 0


# Names that stand for what differs between scenes; the values are put in with the scene.
FUNCTION: Any = None
N = 0


def _enter_step(
    t: float, dt: float, rtol: float, s: int, n: int, mode: int, n_modes: int,
    params: int, n_params: int, atol: int, field: int,
) -> float:  # fmt: skip
    return FUNCTION(
        t, dt, rtol, float_table(s, N), array_of(int_vector(mode, n_modes)),
        array_of(float_vector(params, n_params)), float_vector(atol, N),
    )  # fmt: skip


def _enter_interpolant(
    t: float, dt: float, s: int, n: int, mode: int, n_modes: int,
    params: int, n_params: int, field: int,
) -> int:  # fmt: skip
    return FUNCTION(
        t, dt, float_table(s, N), array_of(int_vector(mode, n_modes)),
        array_of(float_vector(params, n_params)),
    )  # fmt: skip


def _enter_tangent(
    t: float, dt: float, rtol: float, s: int, mode: int, n_modes: int,
    params: int, n_params: int, atol: int, phi: int,
) -> float:  # fmt: skip
    result: float = FUNCTION(
        t, dt, rtol, float_table(s, N), array_of(int_vector(mode, n_modes)),
        array_of(float_vector(params, n_params)), float_vector(atol, N), float_table(phi, N),
    )  # fmt: skip
    return result


def _enter_refresh(s: int, mode: int, n_modes: int, params: int, n_params: int) -> float:
    result: float = FUNCTION(
        float_table(s, N), array_of(int_vector(mode, n_modes)),
        array_of(float_vector(params, n_params)),
    )  # fmt: skip
    return result


def compiled_entry(
    template: Function, native: Any, function: Function, *, cache: bool, n_states: int = 0
) -> Any:
    """Compile the entry to a method's function, or take it from the cache, if that is wanted."""
    entry, digest = _entry(template, function, n_states)

    def compile_it(cached: bool) -> Any:
        return cfunc(native, cache=cache and cached, **ENTRY)(entry)

    return compiled_in_cache(entry, digest, compile_it)


def _entry(template: Function, function: Function, n_states: int) -> tuple[Function, str]:
    """Return the entry to a method's function, to be compiled, and its digest."""
    inner = kernel_in_loop(with_digest(function))
    entry = with_digest(template, FUNCTION=inner, N=n_states)
    return entry, f"{function_digest(entry)}-{driver_digest()}"


def is_compiled(method: Method, n_states: int) -> bool:
    """Tell whether a method's step and interpolant were made for this scene before."""
    step = _entry(_enter_step, method.step, n_states)
    interpolant = _entry(_enter_interpolant, method.interpolant, n_states)
    return is_in_cache(*step) and is_in_cache(*interpolant)


def compiled_step(method: Method, n_states: int, *, cache: bool) -> Any:
    """Return the machine code of a method's step."""
    return compiled_entry(_enter_step, STEP_NATIVE, method.step, cache=cache, n_states=n_states)


def compiled_interpolant(method: Method, n_states: int, *, cache: bool) -> Any:
    """Return the machine code of a method's interpolant."""
    return compiled_entry(
        _enter_interpolant, INTERPOLANT_NATIVE, method.interpolant, cache=cache, n_states=n_states
    )


def compiled_tangent(tangent: Function, n_states: int, *, cache: bool) -> Any:
    """Return the machine code of a tangent."""
    return compiled_entry(_enter_tangent, TANGENT_NATIVE, tangent, cache=cache, n_states=n_states)


def compiled_refresh(method: Method, n_states: int, *, cache: bool) -> Any:
    """Return the machine code that a method runs when the mode has changed."""
    assert method.refresh is not None
    return compiled_entry(
        _enter_refresh, REFRESH_NATIVE, method.refresh, cache=cache, n_states=n_states
    )


# A method's functions, made for a scene: the scene's own functions and its size are put in.


@dataclass(frozen=True)
class Scene:
    """What methods are made from.

    Parameters
    ----------
    field : Callback
        Vector field.
    n_states : int
        Length of the state.
    jacobian, affine : Callback, optional
        The field's derivative, and its affine form.
    guards : Callback, optional
        The event functions, all at once or one by one.
    """

    field: Callback
    n_states: int
    jacobian: Callback | None = None
    affine: Callback | None = None
    guards: Callback | None = None

    @property
    def rate_inputs(self) -> tuple[int, ...]:
        """Components of the state's rate on which the rates of the event functions may depend."""
        return () if self.guards is None else self.guards.elements_of("dy", self.n_states)

    @property
    def steady(self) -> bool:
        """Whether the code of the event functions does not name the time."""
        return self.guards is None or self.guards.elements_of("t", 1) == ()

    @property
    def cacheable(self) -> bool:
        """Whether all functions are machine code, which may be kept for the next process."""
        given = (self.field, self.jacobian, self.affine)
        return all(one.compiled for one in given if one is not None)


@kernel
def matrix(s: Any, first: int, _n: int) -> Any:
    """Return the rows of the table from `first` on, as many as they are long, as a matrix."""
    return square(s, first)


def put_in(template: Any, *, inline: bool = False, **names: Any) -> Any:
    """Return a template with these names put in, to be called by other compiled code."""
    compiled = kernel_in_loop if inline else kernel
    return compiled(with_digest(template, **names))


def explicit(tableau: Tableau, scene: Scene) -> Method:
    """Return the method of a tableau for a scene."""
    n, field = scene.n_states, scene.field.dispatcher
    known = {"FIELD": field, "N": n, "TINY": TINY, "row": row, "sqrt": sqrt}
    arguments = "t, dt, rtol, s, mode, params, atol"
    return Method(
        name=tableau.name,
        order=tableau.order,
        evaluations=tableau.evaluations,
        interpolant_evaluations=len(tableau.dense_nodes),
        interpolant_error=tableau.dense_error,
        in_powers=False,
        step=compose("step", arguments, step_code(tableau), known),
        interpolant=compose(
            "interpolant", "t, dt, s, mode, params", interpolant_code(tableau), known
        ),
        tangent=tangent.tangent_template(tableau, known | _tangent_names(scene, inline=False)),
        tangent_rows=3 * n + PHI_ROWS + n * len(tableau.weights),
        tangent_evaluations=0 if scene.jacobian else 4 * n * len(tableau.weights),
        short_tangent=_short_tangent(tableau, scene),
        short_tangent_evaluations=0 if scene.jacobian else 8 * n,
        last_slope_row=tableau.slope_rows[len(tableau.weights) - 1],
    )


def _tangent_names(scene: Scene, *, inline: bool) -> dict[str, Any]:
    n, names = scene.n_states, {"row": row, "square": square}
    if scene.jacobian is not None:
        by_user = {"JACOBIAN": scene.jacobian.dispatcher, "N": n}
        fill = put_in(tangent.jacobian_by_user, inline=inline, **names, **by_user)
    else:
        by_differences = {"FIELD": scene.field.dispatcher, "N": n}
        fill = put_in(tangent.jacobian_by_differences, **names, **by_differences)
    products = {name: put_in(one, N=n) for name, one in product_templates(n).items()}
    return {"STAGE_JACOBIAN": fill, **products, **_motion_name(n)}


def _motion_name(n: int) -> dict[str, Any]:
    return {"FASTEST_MOTION": put_in(motion.fastest_motion, inline=True, N=n)}


def _short_tangent(tableau: Tableau, scene: Scene) -> Any:
    if tableau.order > short_tangent.HIGHEST_ORDER:
        return None
    names = _tangent_names(scene, inline=True)
    return with_digest(short_tangent.short_tangent, N=scene.n_states, **names)


def taylor_method(scene: Scene) -> Method:
    """Return the Taylor series of affine modes for a scene."""
    assert scene.affine is not None
    n = scene.n_states
    names = {"AFFINE": scene.affine.dispatcher, "N": n, "row": row, "matrix": matrix}
    return Method(
        name=taylor.NAME,
        order=series.ORDER,
        evaluations=taylor.EVALUATIONS,
        interpolant_evaluations=0,
        interpolant_error=0,  # it is the step itself, in powers of a part of its length
        in_powers=True,
        step=series.step_function(n),
        interpolant=with_digest(taylor.interpolant, **names),
        refresh=with_digest(
            taylor.refreshed_disagreement,
            REFRESH=put_in(taylor.refresh, **names, **_motion_name(n)),
            DISAGREEMENT=put_in(taylor.disagreement, **names),
        ),
        tangent=with_digest(taylor.tangent, **names),
        tangent_rows=3 * n + PHI_ROWS,
    )


def rosenbrock_method(scene: Scene) -> Method:
    """Return the Rosenbrock method for a scene."""
    n, field = scene.n_states, scene.field.dispatcher
    names = {"FIELD": field, "N": n, "row": row, "matrix": matrix}
    fill, evaluations = differences.jacobian_by_differences, rosenbrock.EVALUATIONS + 2 * n
    if scene.jacobian is not None:
        fill, evaluations = differences.jacobian_by_user, rosenbrock.EVALUATIONS
        names["JACOBIAN"] = scene.jacobian.dispatcher
    made = {
        "FILL_JACOBIAN": put_in(fill, **names),
        "TIME_DERIVATIVE": put_in(differences.time_derivative, **names),
    }
    return Method(
        name=rosenbrock.NAME,
        order=rosenbrock.ORDER,
        evaluations=evaluations,
        interpolant_evaluations=0,
        interpolant_error=rosenbrock.DENSE_ERROR,
        in_powers=False,
        step=with_digest(rosenbrock.step, **names, **made),
        interpolant=with_digest(rosenbrock.interpolant, **names),
    )
