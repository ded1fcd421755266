"""Explicit Runge-Kutta methods: the code of a step and its interpolant, from a tableau.

The code is unrolled, stage by stage, with literal coefficients: for a small system, a
loop over stages would cost several times the field evaluations.

The code refers to `N`, the number of states, and to the names in its evaluations of the
field. A scene's own code contains the field; generic code calls its address. Both are
generated from the same lines, so they perform the same operations in the same order and
give the same bytes.
"""

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType
from typing import Any

from hopdata.hybrid.arguments import expect
from hopdata.hybrid.compiled.kernel import PARTS
from hopdata.hybrid.layout import END, K1, KEND, LOW_DEGREE, P1, SCRATCH, W1, Y

STANDARD_ROWS = 3  # rows of an interpolant that value and slope at both ends determine
MOST_DENSE = LOW_DEGREE - STANDARD_ROWS  # rows beyond these for which there is room
INDENT = "    "
TINY = 1e-300  # floor of the tolerance, to avoid division by zero

# Code of an evaluation of the field, from a time, a state row and a slope row.
Evaluation = Callable[[str, int, int], list[str]]


@dataclass(frozen=True, kw_only=True)
class Tableau:
    """Coefficients of an explicit Runge-Kutta pair with s stages and a dense output.

    Parameters
    ----------
    order : int
        Order of the method that is propagated.
    nodes : tuple of float
        c_2 ... c_s.
    stages : tuple of tuple of float
        Rows a_2 ... a_s.
    weights : tuple of float
        b_1 ... b_s.
    errors : tuple of tuple of float
        Weights of one or two error estimates on the s slopes and the slope at the end.
        Two are combined as e1^2 / sqrt(e1^2 + 0.01 e2^2) (Hairer, Norsett, Wanner,
        section II.10).
    dense_nodes, dense_stages : tuple
        Further stages for the interpolant, from the s slopes, the end slope, and each
        other.
    dense : tuple of tuple of float
        Weights of the interpolant's rows from the fourth on, at most `MOST_DENSE` rows;
        without any, the interpolant is the cubic.
    dense_error : int
        Error of the interpolant at the middle of a step, in units of the step's
        estimated error, which is of the same order.
    stiff_tenths : int
        Edge of the stability region on the negative axis, in tenths, slightly reduced:
        where stability limits the step, the controller makes it oscillate about this
        edge.
    """

    order: int
    nodes: tuple[float, ...]
    stages: tuple[tuple[float, ...], ...]
    weights: tuple[float, ...]
    errors: tuple[tuple[float, ...], ...]
    dense: tuple[tuple[float, ...], ...] = ()
    dense_error: int
    stiff_tenths: int
    dense_nodes: tuple[float, ...] = ()
    dense_stages: tuple[tuple[float, ...], ...] = ()

    @property
    def degree(self) -> int:
        """Degree of the interpolant."""
        return STANDARD_ROWS + len(self.dense)

    @property
    def slope_rows(self) -> tuple[int, ...]:
        """Rows of the slopes: of the weights, of the end, and of the dense stages."""
        inner = len(self.weights) - 1
        work = [int(W1) + k for k in range(self.work_rows)]
        return (int(K1), *work[:inner], int(KEND), *work[inner:])

    @property
    def work_rows(self) -> int:
        """Number of work rows."""
        return len(self.weights) - 1 + len(self.dense_nodes)


#: Error of the sums that the coefficients of a method must have.
#: Unit: 1. Origin: rounding: published coefficients have 15 digits and more, and a sum
#: of some ten of them, up to 50 in size, loses two or three.
SUMS = 1e-11


def check_tableau(tableau: Tableau) -> None:
    """Raise an error if coefficients do not fit each other, as after a slip of the pen.

    On a constant field each stage, the step and the interpolant must be exact, and the
    error zero. The order of the method is not checked.

    Raises
    ------
    ValueError
        With the name of the coefficients that do not fit.
    """
    stages = len(tableau.weights)
    whole = isinstance(tableau.order, int) and tableau.order > 0
    expect(whole, "order", "a whole number from 1", repr(tableau.order))
    inner = [0, *(len(row) for row in tableau.stages)]
    expect(inner == list(range(stages)), "stages", "rows of 1, 2, ... weights", inner)
    _check_lengths(tableau, stages)
    for nodes, rows in (("nodes", "stages"), ("dense_nodes", "dense_stages")):
        given = getattr(tableau, nodes)
        sums = [sum(row) for row in getattr(tableau, rows)]
        expect(len(given) == len(sums), nodes, f"one for each of {rows}", len(given))
        for k, (node, total) in enumerate(zip(given, sums, strict=True)):
            fits = abs(node - total) < SUMS
            expect(fits, f"{rows}[{k}]", f"the sum {node!r}, its node", total)
    total = sum(tableau.weights)
    expect(abs(total - 1.0) < SUMS, "weights", "the sum 1", total)
    for name in ("errors", "dense"):
        for k, row in enumerate(getattr(tableau, name)):
            expect(abs(sum(row)) < SUMS, f"{name}[{k}]", "the sum 0", sum(row))


def _check_lengths(tableau: Tableau, stages: int) -> None:
    """Raise an error if a row has a weight for a slope that is not there."""
    rows = len(tableau.errors)
    expect(rows in (1, 2), "errors", "one row or two", rows)
    rows = len(tableau.dense)
    expect(rows <= MOST_DENSE, "dense", f"at most {MOST_DENSE} rows", rows)
    slopes = stages + 1
    all_slopes = slopes + len(tableau.dense_stages)
    known = {"errors": slopes, "dense": all_slopes}
    for name, most in known.items():
        for k, row in enumerate(getattr(tableau, name)):
            expect(
                len(row) <= most, f"{name}[{k}]", f"at most {most} weights", len(row)
            )
    for k, row in enumerate(tableau.dense_stages):
        most = slopes + k
        expect(
            len(row) <= most, f"dense_stages[{k}]", f"at most {most} weights", len(row)
        )


def combination(weights: Sequence[float], rows: Sequence[int | str]) -> str:
    """Return code for the weighted sum of rows at column i: a balanced tree of sums."""
    terms = []
    for weight, row in zip(weights, rows, strict=False):  # later rows have no weight
        if weight != 0.0:
            terms.append(f"{weight!r} * s[{row}, i]")
    while len(terms) > 1:
        pairs = zip(terms[::2], terms[1::2], strict=False)
        sums = [f"({one} + {other})" for one, other in pairs]
        odd_one = terms[len(sums) * 2 :]
        terms = sums + odd_one
    if not terms:
        return "0.0"
    return terms[0]


def _loop(*lines: str) -> list[str]:
    """Return code that does this for each state i."""
    return ["for i in range(N):", *(INDENT + line for line in lines)]


def inlined(time: str, state: int, slope: int) -> list[str]:
    """Return code that evaluates a field known at compile time."""
    return [f"FIELD({time}, row(s, {state}), mode, params, row(s, {slope}))"]


def by_address(time: str, state: int, slope: int) -> list[str]:
    """Return code that evaluates a field by its address.

    NaN remains if it raises.
    """
    return [
        f"s[{slope}, 0] = nan",
        f"call_field(field, {time}, s, {state}, mode, params, s, {slope})",
    ]


def _stage(
    evaluation: Evaluation,
    node: float,
    weights: Sequence[float],
    rows: Sequence[int],
    target: int,
) -> list[str]:
    """Return code for a stage: its state in SCRATCH, and its slope in row `target`."""
    return [
        *_loop(f"s[{SCRATCH}, i] = s[{Y}, i] + dt * ({combination(weights, rows)})"),
        *evaluation(f"t + {node!r} * dt", int(SCRATCH), target),
    ]


def _error(tableau: Tableau) -> list[str]:
    """Return code for the error of a step in tolerances, from one or two estimates."""
    rows = tableau.slope_rows
    lines = [
        f"size = max(abs(s[{Y}, i]), abs(s[{END}, i]))",
        "weight = dt / max(atol[i] + rtol * size, TINY)",
    ]
    code = []
    for k, weights in enumerate(tableau.errors):
        code.append(f"total{k} = 0.0")
        lines.append(f"e{k} = weight * ({combination(weights, rows)})")
        lines.append(f"total{k} += e{k} * e{k}")
    code += _loop(*lines)
    if len(tableau.errors) == 1:
        return [*code, "return sqrt(total0 / N)"]
    return [
        *code,
        "if total0 == 0.0:",
        INDENT + "return 0.0",
        "return total0 / sqrt((total0 + 0.01 * total1) * N)",
    ]


def step_code(tableau: Tableau, evaluation: Evaluation = inlined) -> list[str]:
    """Return the body of a method's step function."""
    rows = tableau.slope_rows
    code = []
    stages = zip(tableau.nodes, tableau.stages, strict=True)
    for k, (node, weights) in enumerate(stages, start=1):
        code += _stage(evaluation, node, weights, rows, rows[k])
    slope = combination(tableau.weights, rows)
    code += _loop(f"s[{END}, i] = s[{Y}, i] + dt * ({slope})")
    code += evaluation("t + dt", int(END), int(KEND))
    return code + _error(tableau)


def interpolant_code(tableau: Tableau, evaluation: Evaluation = inlined) -> list[str]:
    """Return the body of the function that prepares a method's interpolant."""
    rows = tableau.slope_rows
    code = []
    stages = zip(tableau.dense_nodes, tableau.dense_stages, strict=True)
    for k, (node, weights) in enumerate(stages, start=len(tableau.weights) + 1):
        code += _stage(evaluation, node, weights, rows, rows[k])
    higher = []
    for k, weights in enumerate(tableau.dense, start=P1 + STANDARD_ROWS):
        higher.append(f"s[{k}, i] = dt * ({combination(weights, rows)})")
    code += _loop(
        f"rise = s[{END}, i] - s[{Y}, i]",
        f"bend = dt * s[{K1}, i] - rise",
        f"s[{P1}, i] = rise",
        f"s[{P1 + 1}, i] = bend",
        f"s[{P1 + 2}, i] = rise - dt * s[{KEND}, i] - bend",
        *higher,
    )
    return [*code, f"return {tableau.degree}"]


def compose(
    name: str, arguments: str, body: list[str], known: dict[str, Any]
) -> FunctionType:
    """Return a function made of these lines, with `known` as its globals."""
    source = "\n".join([f"def {name}({arguments}):", *(INDENT + line for line in body)])
    names: dict[str, Any] = {"__name__": __name__, **known}
    exec(compile(source, __file__, "exec"), names)
    made: FunctionType = names[name]
    return made


def compose_part(part: str, body: list[str], known: dict[str, Any]) -> FunctionType:
    """Return a part of a method made of these lines."""
    return compose(part, PARTS[part].arguments, body, known)


# The methods themselves: coefficients in a file, with their sources.

_COEFFICIENTS = tomllib.loads(
    Path(__file__).with_name("coefficients.toml").read_text("utf-8")
)


def coefficients(method: str) -> dict[str, Any]:
    """Return the coefficients of a method, named as in the file, as tuples."""
    return {name: _numbers(value) for name, value in _COEFFICIENTS[method].items()}


def _numbers(value: Any) -> Any:
    """Return a value of the file with fractions as numbers, and lists as tuples."""
    if isinstance(value, str):
        above, below = value.split("/")
        return int(above) / int(below)
    if isinstance(value, list):
        return tuple(map(_numbers, value))
    return value


DOPRI5 = Tableau(**coefficients("dopri5"))
DOP853 = Tableau(**coefficients("dop853"))
