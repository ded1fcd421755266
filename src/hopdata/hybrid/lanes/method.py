"""A step of DOP853 in lanes, and its interpolant, with literal coefficients."""

from collections.abc import Sequence

from hopdata.hybrid.methods.explicit import DOP853

# The stage at which the guards are evaluated inside a step, and its place, as a
# fraction of the step.
INSIDE = 9
PLACE = DOP853.nodes[INSIDE - 1]

# Another stage inside, at which the guards are compared with what the others show.
EARLY = 7
EARLY_PLACE = DOP853.nodes[EARLY - 1]

STAGES = len(DOP853.weights)
FURTHER = len(DOP853.dense_nodes)
SLOPES = STAGES + 1 + FURTHER  # of the stages, of the end, and of the dense stages
DENSE = 3 + len(DOP853.dense)  # rows of the interpolant for each component
TINY = 1e-300  # floor of the tolerance, to avoid division by zero
DENSE_ERROR = DOP853.dense_error  # interpolant's error in errors of the step
ORDER = DOP853.order

#: Square of the step times the fastest rate at which stability limits the step.
#: Unit: 1. Origin: derived: the edge of DOP853's stability region.
STABLE = (0.1 * DOP853.stiff_tenths) ** 2


def _sum(weights: Sequence[float], start: str = "") -> str:
    """Return code for a weighted sum of slopes at component i, with each term fused."""
    code = start
    for j, weight in enumerate(weights):
        if weight == 0.0:
            continue
        slope = f"k[{j} * N + i]"
        if code:
            code = f"fma({weight!r}, {slope}, {code})"
        else:
            code = f"{weight!r} * {slope}"
    return code


def _stage(node: float, weights: Sequence[float], target: int, state: str) -> list[str]:
    """Return code for a stage: its state, into rows `state`, and its slope."""
    return [
        "for i in range(N):",
        f"    {state}[i] = fma(h, {_sum(weights)}, r.y[i])",
        f"call_field(r.field, fma({node!r}, h, t), {state}, r, state(k, {target} * N))",
    ]


def step_code() -> list[str]:
    """Return the body of ``step(t, h, r)``: error, and whether it is unstable."""
    code = ["k = r.k", "N = r.n"]
    kept = {INSIDE: "r.inner", EARLY: "r.early"}
    stages = zip(DOP853.nodes, DOP853.stages, strict=True)
    for j, (node, weights) in enumerate(stages, start=1):
        code += _stage(node, weights, j, kept.get(j, "r.work"))
    fifth, third = DOP853.errors
    # The last stage is at the end of the step, too: from it to the end, the state moves
    # and the slope turns.
    last_slope = f"k[{STAGES - 1} * N + i]"
    end_slope = f"k[{STAGES} * N + i]"
    return [
        *code,
        "for i in range(N):",
        f"    r.end[i] = fma(h, {_sum(DOP853.weights)}, r.y[i])",
        "    r.moved[i] = r.end[i]",
        f"call_field(r.field, t + h, r.end, r, state(k, {STAGES} * N))",
        "e0 = spread(0.0)",
        "e1 = spread(0.0)",
        "moved = spread(0.0)",
        "turned = spread(0.0)",
        "for i in range(N):",
        "    size = largest(absolute(r.y[i]), absolute(r.end[i]))",
        "    per = 1.0 / largest(fma(r.rtol, size, r.atol[i]), TINY)",
        f"    fifth = ({_sum(fifth)}) * per",
        f"    third = ({_sum(third)}) * per",
        "    e0 = fma(fifth, fifth, e0)",
        "    e1 = fma(third, third, e1)",
        "    move = (r.end[i] - r.work[i]) * per",
        f"    turn = ({end_slope} - {last_slope}) * per",
        "    moved = fma(move, move, moved)",
        "    turned = fma(turn, turn, turned)",
        "error = h * e0 / square_root(fma(0.01, e1, e0) * N + TINY)",
        f"return error, h * h * turned > {STABLE!r} * largest(moved, 0.01)",
    ]


def dense_code() -> list[str]:
    """Return the body of ``prepare(t, h, r)``: slopes and rows of the interpolant."""
    code = ["k = r.k", "p = r.dense", "N = r.n"]
    stages = zip(DOP853.dense_nodes, DOP853.dense_stages, strict=True)
    for j, (node, weights) in enumerate(stages, start=STAGES + 1):
        code += _stage(node, weights, j, "r.work")
    higher = [
        f"    p[j + {3 + q}] = h * ({_sum(row)})" for q, row in enumerate(DOP853.dense)
    ]
    return [
        *code,
        "for i in range(N):",
        "    rise = r.end[i] - r.y[i]",
        "    first = h * k[i]",
        f"    last = h * k[{STAGES} * N + i]",
        f"    j = {DENSE} * i",
        "    p[j] = rise",
        "    p[j + 1] = first - rise",
        "    p[j + 2] = rise - last - p[j + 1]",
        *higher,
    ]
