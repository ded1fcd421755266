"""A step of DOP853 in lanes, and its interpolant, generated as code with literal coefficients."""

from collections.abc import Sequence

from hopdata.hybrid.methods.explicit import DOP853

INSIDE = 9  # stage at which the guards are evaluated inside a step ...
PLACE = DOP853.nodes[INSIDE - 1]  # ... and its place, as a fraction of the step
# Another stage inside, at which the guards are compared with what the others show ...
EARLY = 7
EARLY_PLACE = DOP853.nodes[EARLY - 1]  # ... and its place
STAGES, FURTHER = len(DOP853.weights), len(DOP853.dense_nodes)
SLOPES = (
    STAGES + 1 + FURTHER
)  # slopes of the stages, of the end, and of the dense stages
DENSE = 3 + len(DOP853.dense)  # rows of the interpolant for each component
TINY = 1e-300  # floor of the tolerance, to avoid division by zero
DENSE_ERROR, ORDER = (
    DOP853.dense_error,
    DOP853.order,
)  # interpolant's error in errors of the step
STABLE = (0.1 * DOP853.stiff_tenths) ** 2


def _sum(weights: Sequence[float], start: str = "") -> str:
    """Return code for a weighted sum of slopes at component i, with each term fused."""
    code = start
    for j, weight in enumerate(weights):
        if weight != 0.0:
            slope = f"k[{j} * N + i]"
            code = (
                f"fma({weight!r}, {slope}, {code})" if code else f"{weight!r} * {slope}"
            )
    return code


def _stage(node: float, weights: Sequence[float], target: int, state: str) -> list[str]:
    return [
        "for i in range(N):",
        f"    {state}[i] = fma(h, {_sum(weights)}, r.y[i])",
        f"call_field(r.field, fma({node!r}, h, t), {state}, r, state(k, {target} * N))",
    ]


def step_code() -> list[str]:
    """Return the body of ``step(t, h, r)``: error, and whether it is unstable."""
    code = ["k, N = r.k, r.n"]
    kept = {INSIDE: "r.inner", EARLY: "r.early"}
    for j, (node, weights) in enumerate(
        zip(DOP853.nodes, DOP853.stages, strict=True), start=1
    ):
        code += _stage(node, weights, j, kept.get(j, "r.work"))
    return [
        *code,
        "e0 = e1 = moved = turned = spread(0.0)",
        "for i in range(N):",
        f"    r.end[i] = r.moved[i] = fma(h, {_sum(DOP853.weights)}, r.y[i])",
        f"call_field(r.field, t + h, r.end, r, state(k, {STAGES} * N))",
        "for i in range(N):",
        "    size = largest(absolute(r.y[i]), absolute(r.end[i]))",
        "    per = 1.0 / largest(fma(r.rtol, size, r.atol[i]), TINY)",
        f"    a, b = ({_sum(DOP853.errors[0])}) * per, ({_sum(DOP853.errors[1])}) * per",
        "    e0, e1 = fma(a, a, e0), fma(b, b, e1)",
        f"    a, b = r.end[i] - r.work[i], k[{STAGES} * N + i] - k[{STAGES - 1} * N + i]",
        "    a, b = a * per, b * per",
        "    moved, turned = fma(a, a, moved), fma(b, b, turned)",
        "error = h * e0 / square_root(fma(0.01, e1, e0) * N + TINY)",
        f"return error, h * h * turned > {STABLE!r} * largest(moved, 0.01)",
    ]


def dense_code() -> list[str]:
    """Return the body of ``prepare(t, h, r)``: the interpolant's rows, after the slopes."""
    code = ["k, p, N = r.k, r.dense, r.n"]
    stages = zip(DOP853.dense_nodes, DOP853.dense_stages, strict=True)
    for j, (node, weights) in enumerate(stages, start=STAGES + 1):
        code += _stage(node, weights, j, "r.work")
    return [
        *code,
        "for i in range(N):",
        f"    rise, first, last = r.end[i] - r.y[i], h * k[i], h * k[{STAGES} * N + i]",
        f"    j = {DENSE} * i",
        "    p[j], p[j + 1] = rise, first - rise",
        "    p[j + 2] = rise - last - p[j + 1]",
        *(
            f"    p[j + {3 + q}] = h * ({_sum(row)})"
            for q, row in enumerate(DOP853.dense)
        ),
    ]
