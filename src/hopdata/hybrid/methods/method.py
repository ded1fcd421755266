"""The interface of integration methods to the driver, and the generation of their code.

A method is two functions (three with Jacobians). They are made for a scene, so that
they contain its field and the number of states is a constant: for a small field, calls
and loops would cost more than the evaluations.

    step(t, dt, rtol, s, mode, params, atol, field) -> error in units of the tolerance
    interpolant(t, dt, s, mode, params, field) -> its degree

An explicit method also has generic code, which is made for no scene and calls the field
by its address; other code ignores the address. Its tangents are always generic: code of
their own takes some seconds to compile, and saves a third of the time with four states
and a tenth with twenty.

The table s holds state and slope at the start of the step in rows Y and K1. The step
fills END and KEND with those at its end; the interpolant fills P1 and the rows after it
(see `driver.dense`).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from math import nan, sqrt
from typing import Any

from numba import cfunc

from hopdata.code_cache import compiled_in_cache, function_digest, is_in_cache
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled import memory
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.digest import driver_digest, with_digest
from hopdata.hybrid.layout import PHI_ROWS, W1
from hopdata.hybrid.methods import explicit, sparse, stiff, tangent, taylor
from hopdata.hybrid.methods.sparsity import Pattern
from hopdata.hybrid.numbers import along, duals
from hopdata.hybrid.numbers.derivatives import own_digest

Function = Callable[..., Any]
KEPT = 128  # most methods cached; systems with the same functions share them


@dataclass(frozen=True)
class Method:
    """A method made for a scene.

    Parameters
    ----------
    order : int
        Order of the error estimate that controls the step: the error of a step is
        proportional to this power of its length.
    step, interpolant : callable
        The functions, for Numba to compile.
    evaluations, interpolant_evaluations : int
        Number of field evaluations of each.
    interpolant_error : int
        Error of the interpolant at the middle of a step, in units of the step's
        estimated error.
    in_powers : bool
        Whether the interpolant is in powers of theta.
    work_rows : int
        Rows of the table of states that belong to the method.
    tangent : callable, optional
        ``tangent(t, dt, rtol, s, mode, params, atol, phi, field, jacobian, along)``
        multiplies the step's Jacobian by the one in the first rows of phi and writes
        the product into the next rows. It returns its error in units of the tolerance.
        Field and jacobian are addresses of the user's functions; `along` is the table
        of the code for duals (see `numbers.along`).
    short_tangent : callable, optional
        The same for a short step, along its interpolant (see `methods.tangent`).
    tangent_evaluations, short_evaluations : int
        Number of field evaluations of each.
    tangent_rows : int
        Rows of phi that the tangent needs.
    refresh : callable, optional
        ``refresh(s, mode, params)`` is called whenever the mode may have changed; it
        returns the relative difference between the field and the method's own form of
        it.
    last_slope : int
        Row of an explicit method's last stage slope, which reveals stiffness.
    stiff_tenths : int
        Edge of the stability region on the negative axis, in tenths.
    otherwise : Method, optional
        The same method for a field that does not compile for duals.
    digest : str
        Digest of what its code is made from besides its functions.
    """

    order: int
    step: Function
    interpolant: Function
    evaluations: int
    interpolant_error: int
    work_rows: int
    interpolant_evaluations: int = 0
    in_powers: bool = False
    tangent: Function | None = None
    short_tangent: Function | None = None
    tangent_evaluations: int = 0
    short_evaluations: int = 0
    tangent_rows: int = 0
    refresh: Function | None = None
    last_slope: int = 0
    stiff_tenths: int = 0
    otherwise: "Method | None" = None
    digest: str = ""


# Arguments that machine code receives in another form, and their conversion.
HANDED = {
    "s": ("s, n", "float_table(s, width)"),
    "mode": ("mode, n_modes", "array_of(int_vector(mode, n_modes))"),
    "params": ("params, n_params", "array_of(float_vector(params, n_params))"),
    "atol": ("atol", "float_vector(atol, width)"),
    "phi": ("phi", "float_table(phi, width)"),
    "along": ("along", "int_vector(along, 0)"),
}


@lru_cache(KEPT)
def compiled_part(
    part: str, method: Method, n_states: int, *, cache: bool = True
) -> Any:
    """Return a compiled part of a method, from the cache if `cache` allows."""
    entry, digest = _entry(part, method, n_states)
    native = code.PARTS[part].native

    def compile_it(cached: bool) -> Any:
        return cfunc(native, cache=cache and cached, **code.ENTRY)(entry)

    return compiled_in_cache(entry, digest, compile_it)


@lru_cache(KEPT)
def _entry(part: str, method: Method, n_states: int) -> tuple[Function, str]:
    """Return the entry to a part of a method, ready to compile, and its digest.

    N is 0 in generic code, which works for any number of states.
    """
    inner = code.kernel_in_loop(with_digest(getattr(method, part)))
    taken = []
    given = []
    for name in code.PARTS[part].arguments.split(", "):
        as_taken, as_given = HANDED.get(name, (name, name))
        taken.append(as_taken)
        given.append(as_given)
    body = ["width = n if N == 0 else N", f"return FUNCTION({', '.join(given)})"]
    known = {**vars(memory), "__name__": __name__, "FUNCTION": inner, "N": n_states}
    made = explicit.compose(f"enter_{part}", ", ".join(taken), body, known)
    entry = with_digest(made)
    return entry, f"{function_digest(entry)}-{driver_digest()}{method.digest}"


def is_compiled(method: Method, n_states: int) -> bool:
    """Return whether a method's step and interpolant are compiled for this scene."""
    return all(
        is_in_cache(*_entry(part, method, n_states)) for part in ("step", "interpolant")
    )


# A method's functions for a scene: its own functions and its size are inserted into
# templates.


@dataclass(frozen=True)
class Scene:
    """The parts of a system from which methods are made.

    Parameters
    ----------
    field : Callback
        Vector field.
    n_states : int
        Length of the state.
    jacobian, affine : Callback, optional
        Derivative of the field, and its affine form.
    guards : Callback, optional
        Event functions, all at once or one by one.
    sparsity : Pattern, optional
        Places of the derivative of the field that may differ from zero. The user's
        derivative is then in sparse form.
    """

    field: Callback
    n_states: int
    jacobian: Callback | None = None
    affine: Callback | None = None
    guards: Callback | None = None
    sparsity: Pattern | None = None

    @property
    def dense_jacobian(self) -> Callback | None:
        """Derivative of the field as a full matrix, if the user gives that."""
        return self.jacobian if self.sparsity is None else None

    @property
    def rate_inputs(self) -> tuple[int, ...]:
        """Components of the state's rate on which the guards' rates may depend."""
        if self.guards is None:
            return ()
        return self.guards.elements_of("dy", self.n_states)

    @property
    def cacheable(self) -> bool:
        """Whether all functions are machine code that other processes may load."""
        given = (self.field, self.jacobian, self.affine)
        return all(one.compiled for one in given if one is not None)


def put_in(template: Any, **names: Any) -> Any:
    """Return a template with these names inserted, callable from compiled code."""
    return code.kernel(with_digest(template, **names))


def explicit_method(tableau: explicit.Tableau, scene: Scene | None = None) -> Method:
    """Return the method of a tableau for a scene.

    Without a scene, its code is generic.
    """
    known: dict[str, Any] = {"TINY": explicit.TINY, "sqrt": sqrt}
    if scene is None:
        n = 0
        per_derivative = 0
        body = ["N = s.width"]
        evaluation = explicit.by_address
        known["nan"] = nan
        known["call_field"] = code.call_field_on_arrays
    else:
        n = scene.n_states
        per_derivative = 0 if scene.dense_jacobian else 4 * n  # by differences
        body = []
        evaluation = explicit.inlined
        known["FIELD"] = scene.field.dispatcher
        known["N"] = n
        known["row"] = memory.row
    step = body + explicit.step_code(tableau, evaluation)
    interpolant = body + explicit.interpolant_code(tableau, evaluation)
    stages = len(tableau.weights)
    short = tangent.short_tangent if tableau.order <= tangent.HIGHEST_ORDER else None
    blocks = stages  # a tangent's, after the single rows of its table
    if short is not None:
        blocks = max(stages, tangent.BLOCKS)
    derivatives = stages
    if tangent.has_end_slope(tableau):
        derivatives = stages + 1
        blocks = max(blocks, stages + 1)
    return Method(
        order=tableau.order,
        step=explicit.compose_part("step", step, known),
        interpolant=explicit.compose_part("interpolant", interpolant, known),
        evaluations=stages,  # the first slope is known, the end's is evaluated
        interpolant_evaluations=len(tableau.dense_nodes),
        interpolant_error=tableau.dense_error,
        work_rows=tableau.work_rows,
        tangent=explicit.compose_part(
            "tangent", tangent.tangent_code(tableau), vars(tangent)
        ),
        short_tangent=short,
        tangent_evaluations=per_derivative * derivatives,
        short_evaluations=3 * per_derivative,
        tangent_rows=4 * n + PHI_ROWS + n * blocks,
        last_slope=tableau.slope_rows[stages - 1],
        stiff_tenths=tableau.stiff_tenths,
    )


def taylor_method(scene: Scene) -> Method:
    """Return the Taylor method for the affine modes of a scene."""
    assert scene.affine is not None
    n = scene.n_states
    names = {"AFFINE": scene.affine.dispatcher, "N": n}
    return Method(
        order=taylor.ORDER,
        step=taylor.step_function(n),
        interpolant=with_digest(taylor.interpolant, **names),
        evaluations=0,
        interpolant_error=0,  # it is the step itself, in powers of theta
        in_powers=True,
        work_rows=taylor.work_rows(n),
        refresh=with_digest(taylor.refresh, **names),
        tangent=with_digest(taylor.tangent, **names),
        tangent_rows=4 * n + PHI_ROWS,
    )


def rosenbrock_method(scene: Scene) -> Method:
    """Return the Rosenbrock method for a scene.

    Where the field does not compile for duals, its other form is used.
    """
    if scene.sparsity is not None:
        return sparse_rosenbrock_method(scene, scene.sparsity)
    names = {"FIELD": scene.field.dispatcher, "N": scene.n_states}
    if scene.jacobian is None:
        fill = put_in(stiff.jacobian_by_differences, **names)
        evaluations = stiff.EVALUATIONS + 2 * scene.n_states
    else:
        names["JACOBIAN"] = scene.jacobian.dispatcher
        fill = put_in(stiff.jacobian_by_user, **names)
        evaluations = stiff.EVALUATIONS
    in_time = put_in(stiff.time_derivative, **names)
    by_differences = _rosenbrock(scene, fill, in_time, evaluations)
    if not scene.field.compiled or scene.field.no_dual:
        return by_differences
    in_passes, at_once = _fills_by_duals(scene)
    if scene.jacobian is None:
        fill = at_once
        in_time = put_in(stiff.no_time_derivative)
    else:
        in_time = put_in(stiff.time_derivative_by_duals, IN_PASSES=in_passes)
    exact = _rosenbrock(scene, fill, in_time, stiff.EVALUATIONS - 1)
    return replace(exact, otherwise=by_differences, digest=own_digest())


def _fills_by_duals(scene: Scene) -> tuple[Any, Any]:
    """Return what fills derivatives by duals: that in time alone, or all."""
    n = scene.n_states
    call = scene.field.dual
    names = stiff.dual_names(call, n, time_only=True)
    harvest = {"HARVEST": along.harvest}
    in_time = put_in(stiff.jacobian_in_passes, **names, **harvest)
    names = stiff.dual_names(call, n, time_only=False)
    width = names["WIDTH"]
    if width <= n:
        return in_time, put_in(stiff.jacobian_in_passes, **names, **harvest)
    harvest["HARVEST"] = duals.harvest_all(n, width, timed=True)
    return in_time, put_in(stiff.jacobian_by_duals, **names, **harvest)


def _rosenbrock(scene: Scene, fill: Any, in_time: Any, evaluations: int) -> Method:
    """Return the Rosenbrock method with these functions for the field's derivatives."""
    names = {"FIELD": scene.field.dispatcher, "N": scene.n_states}
    made = {"FILL_JACOBIAN": fill, "TIME_DERIVATIVE": in_time}
    made["PREPARE"] = put_in(stiff.prepare_dense, N=scene.n_states)
    made["SOLVE"] = put_in(stiff.solve_dense, N=scene.n_states)
    return Method(
        order=stiff.ORDER,
        step=with_digest(stiff.step, **names, **made),
        interpolant=with_digest(stiff.interpolant, **names),
        evaluations=evaluations,
        interpolant_error=stiff.DENSE_ERROR,
        work_rows=stiff.work_rows(scene.n_states),
    )


def sparse_rosenbrock_method(scene: Scene, pattern: Pattern) -> Method:
    """Return the Rosenbrock method with a sparse Jacobian of this pattern."""
    names = {"FIELD": scene.field.dispatcher, "N": scene.n_states}
    if scene.jacobian is None:
        fill = sparse.jacobian_by_differences
    else:
        fill = sparse.jacobian_by_user
        names["JACOBIAN"] = scene.jacobian.dispatcher
    in_time = put_in(stiff.time_derivative, **names)
    plain = _sparse_rosenbrock(scene, pattern, put_in(fill, **names), in_time)
    if scene.jacobian is not None:
        return replace(plain, evaluations=stiff.EVALUATIONS)
    n_colours = pattern.structure.n_colours
    evaluations = stiff.EVALUATIONS + 2 * n_colours
    by_differences = replace(plain, evaluations=evaluations)
    if not scene.field.compiled or scene.field.no_dual:
        return by_differences
    names |= sparse.dual_names(scene.field.dual, n_colours)
    fill = put_in(sparse.jacobian_by_duals, **names)
    in_time = put_in(stiff.no_time_derivative)
    exact = _sparse_rosenbrock(scene, pattern, fill, in_time)
    rows = exact.work_rows + sparse.dual_rows(scene.n_states, n_colours)
    digest = own_digest()
    return replace(exact, work_rows=rows, otherwise=by_differences, digest=digest)


def _sparse_rosenbrock(
    scene: Scene, pattern: Pattern, fill: Any, in_time: Any
) -> Method:
    """Return the method with these functions for the field's derivatives."""
    structure = pattern.structure
    factors = structure.factors
    names = {"FIELD": scene.field.dispatcher, "N": scene.n_states}
    made = {"FILL_JACOBIAN": fill, "TIME_DERIVATIVE": in_time}
    factorise: Any = sparse.factorise_band
    solve_band: Any = sparse.solve_band
    if factors.is_narrow:
        widths = {"BELOW": factors.below, "ABOVE": factors.above}
        factorise = put_in(sparse.factorise_narrow, **widths)
        solve_band = put_in(sparse.solve_narrow, **widths)
    made["SOLVE"] = put_in(sparse.solve_pivoted, SOLVE_BAND=solve_band)
    if not factors.is_band:
        factorise = sparse.factorise_sparse
        made["SOLVE"] = put_in(sparse.solve_corrected)
    made["PREPARE"] = put_in(sparse.prepare, FACTORISE=factorise, N=scene.n_states)
    return Method(
        order=stiff.ORDER,
        step=with_digest(stiff.step, **names, **made),
        interpolant=with_digest(stiff.interpolant, **names),
        evaluations=stiff.EVALUATIONS - 1,
        interpolant_error=stiff.DENSE_ERROR,
        work_rows=int(stiff.JAC - W1) + structure.work_rows,
    )
