"""Explicit Runge-Kutta methods: from a tableau to the code of a step and of its interpolant.

The code is written out, stage by stage, with the coefficients in it: for a small system the
arithmetic of a loop over stages would cost several times the evaluations.

It knows the names `N`, the number of states, and those in its evaluations of the field: a scene's
own code has the field in it, generic code calls its address. Both come from the same lines, so that
they do the same operations in the same order, and give the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import FunctionType
from typing import Any

from hopdata.hybrid.layout import END, K1, KEND, P1, SCRATCH, W1, Y

STANDARD_ROWS = 3  # of an interpolant: those that value and slope at both ends determine
INDENT = "    "
TINY = 1e-300  # never divide by a tolerance of zero

Evaluation = Callable[[str, int, int], list[str]]  # at a time, from a row of states, into a row


@dataclass(frozen=True)
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
        Weights of one or two error estimates on the s slopes and the slope at the end. Two are
        combined as e1^2 / sqrt(e1^2 + 0.01 e2^2) (Hairer, Norsett, Wanner, section II.10).
    dense_nodes, dense_stages : tuple
        Further stages for the interpolant, on the s slopes, the one at the end, and each other.
    dense : tuple of tuple of float
        Weights of its rows from the fourth on.
    dense_error : int
        Error of the interpolant at the middle of a step, in units of the estimated error of the
        step, which is of the same order.
    stiff_tenths : int
        Edge of the region of stability on the negative axis, in tenths, a little reduced: where
        stability limits the step, the controller makes it swing about it.
    """

    order: int
    nodes: tuple[float, ...]
    stages: tuple[tuple[float, ...], ...]
    weights: tuple[float, ...]
    errors: tuple[tuple[float, ...], ...]
    dense: tuple[tuple[float, ...], ...]
    dense_error: int
    stiff_tenths: int
    dense_nodes: tuple[float, ...] = ()
    dense_stages: tuple[tuple[float, ...], ...] = ()

    @property
    def evaluations(self) -> int:
        """Field evaluations of a step: the first slope is known, the last one is wanted."""
        return len(self.weights)

    @property
    def degree(self) -> int:
        """Degree of the interpolant."""
        return STANDARD_ROWS + len(self.dense)

    @property
    def slope_rows(self) -> tuple[int, ...]:
        """Rows of the slopes, in the order of the weights, of the end's, and of the dense ones."""
        inner = len(self.weights) - 1
        work = [int(W1) + k for k in range(inner + len(self.dense_nodes))]
        return (int(K1), *work[:inner], int(KEND), *work[inner:])

    @property
    def work_rows(self) -> int:
        """Number of work rows."""
        return len(self.weights) - 1 + len(self.dense_nodes)


def combination(weights: Sequence[float], rows: Sequence[int]) -> str:
    """Return the weighted sum of rows at column i, as code: a balanced tree of additions."""
    terms = [f"{w!r} * s[{r}, i]" for w, r in zip(weights, rows, strict=False) if w != 0.0]
    while len(terms) > 1:
        pairs = [f"({a} + {b})" for a, b in zip(terms[::2], terms[1::2], strict=False)]
        terms = pairs + terms[len(pairs) * 2 :]
    return terms[0] if terms else "0.0"


def _loop(*lines: str) -> list[str]:
    return ["for i in range(N):", *(INDENT + line for line in lines)]


def inlined(time: str, state: int, slope: int) -> list[str]:
    """Return an evaluation of a field that is known when the code is compiled."""
    return [f"FIELD({time}, row(s, {state}), mode, params, row(s, {slope}))"]


def by_address(time: str, state: int, slope: int) -> list[str]:
    """Return an evaluation of a field by its address; NaN stays behind if it raises."""
    return [
        f"s[{slope}, 0] = nan",
        f"call_field(field, {time}, s, {state}, mode, params, s, {slope})",
    ]


def _stage(
    evaluation: Evaluation, node: float, weights: Sequence[float], rows: Sequence[int], target: int
) -> list[str]:
    return [
        *_loop(f"s[{SCRATCH}, i] = s[{Y}, i] + dt * ({combination(weights, rows)})"),
        *evaluation(f"t + {node!r} * dt", int(SCRATCH), target),
    ]


def _error(tableau: Tableau) -> list[str]:
    rows = tableau.slope_rows
    lines = [f"weight = dt / max(atol[i] + rtol * max(abs(s[{Y}, i]), abs(s[{END}, i])), TINY)"]
    for k, weights in enumerate(tableau.errors):
        lines += [f"e{k} = weight * ({combination(weights, rows)})", f"total{k} += e{k} * e{k}"]
    code = [f"total{k} = 0.0" for k in range(len(tableau.errors))] + _loop(*lines)
    if len(tableau.errors) == 1:
        return [*code, "return sqrt(total0 / N)"]
    return [
        *code,
        "if total0 == 0.0:",
        INDENT + "return 0.0",
        "return total0 / sqrt((total0 + 0.01 * total1) * N)",
    ]


def step_code(tableau: Tableau, evaluation: Evaluation = inlined) -> list[str]:
    """Return the body of the step function of a method."""
    rows, code = tableau.slope_rows, []
    for k, (node, weights) in enumerate(zip(tableau.nodes, tableau.stages, strict=True)):
        code += _stage(evaluation, node, weights, rows, rows[k + 1])
    code += _loop(f"s[{END}, i] = s[{Y}, i] + dt * ({combination(tableau.weights, rows)})")
    code += evaluation("t + dt", int(END), int(KEND))
    return code + _error(tableau)


def interpolant_code(tableau: Tableau, evaluation: Evaluation = inlined) -> list[str]:
    """Return the body of the function that prepares the interpolant of a method."""
    rows, code = tableau.slope_rows, []
    first = len(tableau.weights) + 1
    for k, (node, weights) in enumerate(
        zip(tableau.dense_nodes, tableau.dense_stages, strict=True)
    ):
        code += _stage(evaluation, node, weights, rows, rows[first + k])
    code += _loop(
        f"rise = s[{END}, i] - s[{Y}, i]",
        f"bend = dt * s[{K1}, i] - rise",
        f"s[{P1}, i] = rise",
        f"s[{P1 + 1}, i] = bend",
        f"s[{P1 + 2}, i] = rise - dt * s[{KEND}, i] - bend",
        *(
            f"s[{P1 + STANDARD_ROWS + k}, i] = dt * ({combination(weights, rows)})"
            for k, weights in enumerate(tableau.dense)
        ),
    )
    return [*code, f"return {tableau.degree}"]


def compose(name: str, arguments: str, body: list[str], known: dict[str, Any]) -> FunctionType:
    """Return a function made of these lines, to which these global names are known."""
    source = "\n".join([f"def {name}({arguments}):", *(INDENT + line for line in body)])
    names: dict[str, Any] = {"__name__": __name__, **known}
    exec(compile(source, __file__, "exec"), names)
    made: FunctionType = names[name]
    return made


# The Dormand-Prince 5(4) pair and its free fourth-order dense output.
#
# Source: Hairer, Norsett, Wanner, *Solving Ordinary Differential Equations I*, table II.5.2
# (the pair) and equation II.6.12 (the interpolant).

_LAST = (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84)

DOPRI5 = Tableau(
    order=5,
    nodes=(1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0),
    stages=(
        (1 / 5,),
        (3 / 40, 9 / 40),
        (44 / 45, -56 / 15, 32 / 9),
        (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
        (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    ),
    weights=_LAST,
    errors=((71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40),),
    dense=(
        (
            -12715105075 / 11282082432, 0.0, 87487479700 / 32700410799, -10690763975 / 1880347072,
            701980252875 / 199316789632, -1453857185 / 822651844, 69997945 / 29380423,
        ),
    ),
    dense_error=8,
    stiff_tenths=30,  # of 33.1
)  # fmt: skip


# The Dormand-Prince 8(5,3) method and its seventh-order dense output.
#
# Source: the same book, section II.10, and the coefficients of Hairer's code DOP853.

DOP853 = Tableau(
    order=8,
    nodes=(
        0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726,
        0.3333333333333333, 0.25, 0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571,
        1.0
    ),
    stages=(
        (0.05260015195876773,),
        (0.0197250569845379, 0.0591751709536137),
        (0.02958758547680685, 0.0, 0.08876275643042054),
        (0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792),
        (0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242),
        (0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125),
        (
            0.03709200011850479, 0.0, 0.0, 0.17038392571223998, 0.10726203044637328,
            -0.015319437748624402, 0.008273789163814023
        ),
        (
            0.6241109587160757, 0.0, 0.0, -3.3608926294469414, -0.868219346841726,
            27.59209969944671, 20.154067550477894, -43.48988418106996
        ),
        (
            0.47766253643826434, 0.0, 0.0, -2.4881146199716677, -0.590290826836843,
            21.230051448181193, 15.279233632882423, -33.28821096898486, -0.020331201708508627
        ),
        (
            -0.9371424300859873, 0.0, 0.0, 5.186372428844064, 1.0914373489967295,
            -8.149787010746927, -18.52006565999696, 22.739487099350505, 2.4936055526796523,
            -3.0467644718982196
        ),
        (
            2.273310147516538, 0.0, 0.0, -10.53449546673725, -2.0008720582248625,
            -17.9589318631188, 27.94888452941996, -2.8589982771350235, -8.87285693353063,
            12.360567175794303, 0.6433927460157636
        ),
    ),
    weights=(
        0.054293734116568765, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003,
        -5.801203960010585, 0.3111643669578199, -0.1521609496625161, 0.20136540080403034,
        0.04471061572777259
    ),
    errors=(
        (
            0.01312004499419488, 0.0, 0.0, 0.0, 0.0, -1.2251564463762044, -0.4957589496572502,
            1.6643771824549864, -0.35032884874997366, 0.3341791187130175, 0.08192320648511571,
            -0.022355307863886294
        ),
        (
            -0.18980075407240762, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003,
            -5.801203960010585, -0.4226823213237919, -0.1521609496625161, 0.20136540080403034,
            0.02265179219836082
        ),
    ),
    dense_error=24,
    stiff_tenths=61,  # of 64
    dense_nodes=(0.1, 0.2, 0.7777777777777778),
    dense_stages=(
        (
            0.056167502283047954, 0.0, 0.0, 0.0, 0.0, 0.0, 0.25350021021662483,
            -0.2462390374708025, -0.12419142326381637, 0.15329179827876568, 0.00820105229563469,
            0.007567897660545699, -0.008298
        ),
        (
            0.03183464816350214, 0.0, 0.0, 0.0, 0.0, 0.028300909672366776, 0.053541988307438566,
            -0.05492374857139099, 0.0, 0.0, -0.00010834732869724932, 0.0003825710908356584,
            -0.00034046500868740456, 0.1413124436746325
        ),
        (
            -0.42889630158379194, 0.0, 0.0, 0.0, 0.0, -4.697621415361164, 7.683421196062599,
            4.06898981839711, 0.3567271874552811, 0.0, 0.0, 0.0, -0.0013990241651590145,
            2.9475147891527724, -9.15095847217987
        ),
    ),
    dense=(
        (
            -8.428938276109013, 0.0, 0.0, 0.0, 0.0, 0.5667149535193777, -3.0689499459498917,
            2.38466765651207, 2.117034582445028, -0.871391583777973, 2.2404374302607883,
            0.6315787787694688, -0.08899033645133331, 18.148505520854727, -9.194632392478356,
            -4.436036387594894
        ),
        (
            10.427508642579134, 0.0, 0.0, 0.0, 0.0, 242.28349177525817, 165.20045171727028,
            -374.5467547226902, -22.113666853125306, 7.733432668472264, -30.674084731089398,
            -9.332130526430229, 15.697238121770845, -31.139403219565178, -9.35292435884448,
            35.81684148639408
        ),
        (
            19.985053242002433, 0.0, 0.0, 0.0, 0.0, -387.0373087493518, -189.17813819516758,
            527.8081592054236, -11.57390253995963, 6.8812326946963, -1.0006050966910838,
            0.7777137798053443, -2.778205752353508, -60.19669523126412, 84.32040550667716,
            11.99229113618279
        ),
        (
            -25.69393346270375, 0.0, 0.0, 0.0, 0.0, -154.18974869023643, -231.5293791760455,
            357.6391179106141, 93.40532418362432, -37.45832313645163, 104.0996495089623,
            29.8402934266605, -43.53345659001114, 96.32455395918828, -39.17726167561544,
            -149.72683625798564
        ),
    ),
)  # fmt: skip
