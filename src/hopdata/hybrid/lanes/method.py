"""A step of DOP853 in lanes, and its interpolant, with literal coefficients."""

from collections.abc import Sequence
from math import sqrt

from hopdata.hybrid.driver.enclosure import GRAIN
from hopdata.hybrid.methods.explicit import DOP853

STAGES = len(DOP853.weights)

# A stage inside the step whose state is of fifth order, and its place, as a fraction of
# the step: its slope shows how the field bends.
INSIDE = 9
PLACE = DOP853.nodes[INSIDE - 1]

FURTHER = len(DOP853.dense_nodes)
SLOPES = STAGES + 1 + FURTHER  # of the stages, of the end, and of the dense stages
DENSE = 3 + len(DOP853.dense)  # rows of the interpolant for each component
TINY = 1e-300  # floor of the tolerance, to avoid division by zero
DENSE_ERROR = DOP853.dense_error  # interpolant's error in errors of the step
ORDER = DOP853.order

#: Largest sum of the sizes of a row's terms, written in powers of x: the rounding of a
#: state is bounded by them, as in `driver.enclosure`.
#: Unit: 1. Origin: derived: 1 + 3 + 3 + 1, from the last row, x^4 r^3.
TERMS = 8.0

#: The same in a state's slope.
#: Unit: 1. Origin: derived: 4 + 5 3 + 6 3 + 7 1, from the last row.
SLOPE_TERMS = 44.0

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


def _stage(node: float, weights: Sequence[float], target: int) -> list[str]:
    """Return code for a stage: its state, into `work`, and its slope."""
    return [
        "for i in range(N):",
        f"    r.work[i] = fma(h, {_sum(weights)}, r.y[i])",
        f"call_field(r.field, fma({node!r}, h, t), r.work, r, state(k, {target} * N))",
    ]


def step_code() -> list[str]:
    """Return the body of ``step(t, h, r)``: error, and whether it is unstable."""
    code = ["k = r.k", "N = r.n"]
    stages = zip(DOP853.nodes, DOP853.stages, strict=True)
    for j, (node, weights) in enumerate(stages, start=1):
        code += _stage(node, weights, j)
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
        code += _stage(node, weights, j)
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


def _function_of_row(q: int) -> tuple[int, int]:
    """Return the powers of x and of r = 1 - x by which row q of the interpolant counts.

    The functions are x, x r, x^2 r, x^2 r^2, ...
    """
    return q // 2 + 1, (q + 1) // 2


def _power(x: float, n: int) -> float:
    """Return a power by products, which round alike on every processor."""
    result = 1.0
    for _ in range(n):
        result *= x
    return result


def _largest_value(q: int) -> float:
    """Return the largest value of x^a r^b in the unit interval; the least is zero."""
    a, b = _function_of_row(q)
    return _power(a / (a + b), a) * _power(b / (a + b), b)


def _range_of_slope(q: int) -> tuple[float, float]:
    """Return the least and largest slope of x^a r^b in the unit interval.

    They are at an end, or where its second derivative is zero.
    """
    a, b = _function_of_row(q)
    if b == 0:
        return 1.0, 1.0
    n = a + b
    aside = sqrt(a * b * (n - 1))
    places = [0.0, 1.0]
    for root in (a * (n - 1) - aside, a * (n - 1) + aside):
        places.append(min(max(root / (n * (n - 1)), 0.0), 1.0))
    slopes = []
    for x in places:
        steep = _power(x, a - 1) * _power(1.0 - x, b - 1)
        slopes.append(steep * (a - n * x))
    return min(slopes), max(slopes)


def range_code() -> list[str]:
    """Return the body of ``enclose(h, r)``: ranges of states and slopes over the step.

    Each row of the interpolant counts by a function of known range: the sum of its
    ranges encloses the state. This is wider than the enclosure in the driver, which
    examines what it leaves undecided, and costs a fifth.
    """
    code = [
        "per_s = 1.0 / h",
        "for i in range(r.n):",
        f"    j = {DENSE} * i",
    ]
    sums = {"middle": "", "half": "", "slope": "", "turn": ""}
    for q in range(DENSE):
        code += [f"    p{q} = r.dense[j + {q}]", f"    s{q} = absolute(p{q})"]
        most = _largest_value(q)
        low, high = _range_of_slope(q)
        weights = {
            "middle": (0.5 * most, f"p{q}"),
            "half": (0.5 * most, f"s{q}"),
            "slope": (0.5 * (low + high), f"p{q}"),
            "turn": (0.5 * (high - low), f"s{q}"),
        }
        for name, (weight, row) in weights.items():
            if weight == 0.0:
                continue
            term = f"{weight!r} * {row}"
            if sums[name]:
                term = f"fma({weight!r}, {row}, {sums[name]})"
            sums[name] = term
    code += [f"    {name} = {summed}" for name, summed in sums.items()]
    total = " + ".join(f"s{q}" for q in range(DENSE))
    return [
        *code,
        f"    total = {total}",
        # What rests has no rounding.
        f"    rounding = fma({TERMS!r}, total, absolute(r.y[i]))",
        "    rounding = where(total > 0.0, rounding, 0.0)",
        f"    half = fma({GRAIN!r}, rounding, half)",
        f"    turn = fma({SLOPE_TERMS * GRAIN!r}, total, turn)",
        "    k = RANGE * i",
        "    middle = r.y[i] + middle",
        "    r.ranges[k] = middle - half",
        "    r.ranges[k + 1] = middle + half",
        "    r.ranges[k + 2] = (slope - turn) * per_s",
        "    r.ranges[k + 3] = (slope + turn) * per_s",
    ]
