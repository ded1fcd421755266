"""A method's functions, made for a scene: the scene's own functions and its size are put in."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any

from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.digest import with_digest
from hopdata.hybrid.compiled.kernel import kernel, kernel_in_loop
from hopdata.hybrid.compiled.views import row, square
from hopdata.hybrid.driver.layout import PHI_ROWS
from hopdata.hybrid.methods import (
    differences,
    motion,
    rosenbrock,
    series,
    short_tangent,
    tangent,
    taylor,
)
from hopdata.hybrid.methods.explicit import (
    TINY,
    Tableau,
    compose,
    interpolant_code,
    step_code,
)
from hopdata.hybrid.methods.method import Method
from hopdata.hybrid.methods.products import product_templates


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
