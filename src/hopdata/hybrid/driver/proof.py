"""Prove on a step's interpolant that guards stay clear, or find the first that flips.

The states are enclosed over a piece of the step (`enclosure`), and the guards' own
code, compiled for ranges of value and rate, is run once for all guards (`paths`).
From left to right, a piece is *clear* if each guard is: its range excludes zero; or its
values at both ends are so far from zero that no rate in its range takes it there (the
mean value theorem); or its rate has one sign, and its ends are on the same side. There
is one *flip* if the rate has one sign and the ends differ. Otherwise the piece is
divided: around the place where a comparison or a jump of the code is expected to
change, or else in the middle.

A comparison that the ranges leave open is answered both ways, and the hull of all runs
counts. A guard that this concerns is not judged by its rate, because it may jump.

What is not decided in the shortest piece is decided by the signs at its ends. If they
agree, nothing is proven there: the step is counted in UNPROVEN. So is a step in which a
guard is zero to within rounding over a whole piece, and one that exhausts its budget of
pieces: the rest of this step is only sampled. Where the guards have no code for ranges,
all steps are sampled.
"""

from math import inf

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.compiled.memory import address_of, float_vector
from hopdata.hybrid.driver.ahead import knows_box, reach_less
from hopdata.hybrid.driver.dense import prepare_interpolant
from hopdata.hybrid.driver.enclosure import GRAIN, begin_enclosing, begin_pieces
from hopdata.hybrid.driver.localise import FALLS, NONE, first_root
from hopdata.hybrid.driver.paths import BYTES, answer_next, look_over, run_once
from hopdata.hybrid.driver.problem import (
    EPS,
    ROUNDING,
    Problem,
    awake,
    blur,
    has_flipped,
    is_leaving,
    time_resolution,
)
from hopdata.hybrid.driver.watch import facing, gather_unclear, look
from hopdata.hybrid.layout import Memory
from hopdata.hybrid.numbers import answers

# Verdicts on a piece. MAY_BE_ZERO: a guard may be zero in all of it, but for rounding.
CLEAR, FLIPS, DIVIDE, MAY_BE_ZERO = 0, 1, 2, 3
# Values of DOUBT: only signs have decided, which a flip just before may excuse.
EXCUSED, DOUBTED = 1, 2

#: Length of the shortest piece.
#: Unit: time resolutions. Origin: chosen.
SHORTEST = 8.0

#: Length of the shortest piece of a step that starts near t = 0.
#: Unit: fraction of the step. Origin: chosen: 256 roundings of the step's length.
FINEST = 2.0**-44

#: Length, in shortest pieces, up to which pieces that only signs have decided count as
#: proven if a guard flips right after them.
#: Unit: 1. Origin: chosen.
SURE = 2.0**12

#: Pieces examined in one step, at first. Each step that exhausts them halves this.
#: Unit: 1. Origin: chosen.
MOST_LOOKS = 4096

#: Pieces examined in one step, at least.
#: Unit: 1. Origin: chosen.
LEAST_LOOKS = 64

#: Margin around the place where a comparison is expected to change.
#: Unit: fraction of the piece. Origin: chosen.
BAND = 2.0**-10

#: Largest such margin; a piece that would need more is halved.
#: Unit: fraction of the piece. Origin: chosen.
WIDEST_BAND = 0.2

#: Factor by which the piece after a clear one is longer.
#: Unit: 1. Origin: chosen.
GROW = 2.0

#: The same after a very short piece, and what counts as one, as a fraction of the step.
#: Unit: 1. Origin: chosen.
GROW_MUCH = 16.0
VERY_SHORT = 2.0**-12

#: Longest undecided piece in which it is asked what of a guard's value may be rounding.
#: Unit: fraction of the step. Origin: chosen.
DOUBTFUL = 2.0**-8

#: Roundings of h at the ends of a piece, as a fraction of its range.
#: Unit: 1. Origin: rounding: eight units in the last place of a double.
END_ROUNDING = 8.0 * EPS

#: Largest change of h in the other direction, over a piece in which a guard counts as
#: falling or rising.
#: Unit: fraction of its range. Origin: rounding: 128 units in the last place of a
#: double, as states and slopes are enclosed with 64. Otherwise a body that starts from
#: rest would not fall in the first piece.
STILL = 128.0 * EPS

#: Part of a piece that is examined next if a guard leaves its surface in it and
#: returns: in a shorter piece its rate may keep its sign.
#: Unit: 1. Origin: chosen.
LEAVING = 0.25

#: Multiple of the rounding of h within which a guard that has just flipped rests.
#: Unit: 1. Origin: derived: a state's range reaches GRAIN of its terms to both sides
#: where the state itself does not move, and h is taken to err by ROUNDING of its own:
#: of such a state, h has a range of GRAIN / ROUNDING = 16 roundings. Chosen: h may be
#: made of some four of them.
RESTS_WITHIN = 4.0 * GRAIN / ROUNDING

#: Error of an interpolant.
#: Unit: tolerances of a step. Origin: measured: 1.1 for DOP853, 0.3 for DOPRI5, rounded
#: up.
INTERPOLANT = 2.0

#: Least distance from its surface, over its range within the piece, of a guard that is
#: not asked whether it turns closer than the tolerance can tell.
#: Unit: 1. Origin: chosen.
NEARLY = 1.0

#: Range of a guard, over what the tolerance makes of it, at which its least distance is
#: known well enough to be compared.
#: Unit: 1. Origin: chosen.
SHARP = 8.0

#: Shortest piece that is divided only for that.
#: Unit: fraction of the step. Origin: chosen.
SHORTEST_IF_CLOSE = 2.0**-16

#: Samples of a step whose guards have no code for ranges.
#: Unit: 1. Origin: chosen.
SAMPLES = 8

#: Samples of a whole run whose guards have no code for ranges.
#: Unit: 1. Origin: chosen.
SAMPLES_OF_RUN = 256.0

# What was found: the guard that flips first (NONE if none does), where, as a fraction
# of the step, and whether only the signs at the ends of the shortest piece say so.
Found = tuple[int, float, bool]


@kernel_apart
def gather_near(p: Problem, m: Memory, rows: int) -> int:
    """Put the guards into NEAR whose ranges do not exclude zero by far.

    Returns their number.
    """
    g = m.guards
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        low = g[rows, k]
        high = g[rows + 1, k]
        least = low if p.mode[k] > 0 else -high
        g[at.CLEARANCE, k] = least - NEARLY * (high - low)
    return gather_unclear(p, m)


# One guard in a piece.


@kernel
def is_past(g: float, d: float, noise: float) -> bool:
    """Return whether a margin and its rate, at one place, show a guard past it."""
    return g < -noise or (g <= 0.0 and d < 0.0)


@kernel
def is_past_at(
    p: Problem, m: Memory, k: int, row: int, dt: float, resolution: float
) -> bool:
    """Return whether guard k is past its surface by the values in a row.

    Inside a step of length `dt`, rates are those of the interpolant. Far from the
    origin, the terms of a guard that has flipped are large, and its rate there may err
    by their rounding over `dt`: a fall that is no faster shows nothing.
    """
    g = facing(p.mode[k], m.guards[row, k])
    d = facing(p.mode[k], m.guards[row + 1, k])
    noise = blur(m.guards[at.SIZE, k], d, resolution)
    if row != at.H1:
        d += ROUNDING * m.guards[at.PARTS, k] / dt
    return is_past(g, d, noise)


@kernel
def is_on(g: float, d: float, noise: float) -> bool:
    """Return whether a guard is on its surface by rounding, and does not pass it."""
    return g <= 0.0 or (g <= noise and d > 0.0)


@kernel
def lowest(ga: float, gz: float, least: float, most: float, span: float) -> float:
    """Return a lower bound of a function between its ends, by the range of its rate."""
    if not least < 0.0 < most:
        return min(ga, gz)
    x = (gz - ga - most * span) / (least - most)
    x = min(max(x, 0.0), span)
    return min(ga + least * x, gz - most * (span - x))


@kernel_in_loop
def judge(  # noqa: PLR0913 (a piece, its ends and its rows, in a compiled loop)
    p: Problem, m: Memory, k: int, rows: int, left: int, right: int, dt: float,
    a: float, z: float, resolution: float,
) -> int:  # fmt: skip
    """Judge guard k in a piece by its ranges and by its values at both ends.

    Writes into CLEARANCE: of a clear guard that turns, its least distance from the
    surface; FALLS, if it flips and falls all through the piece; infinity otherwise. H
    receives the length of its range. If the guard leaves its surface in a piece that is
    to be divided, CUT becomes LEAVING at most.
    """
    g = m.guards
    lock = p.mode[k]
    low = facing(lock, g[rows, k] if lock > 0 else g[rows + 1, k])
    high = facing(lock, g[rows + 1, k] if lock > 0 else g[rows, k])
    least = facing(lock, g[rows + 2, k] if lock > 0 else g[rows + 3, k])
    most = facing(lock, g[rows + 3, k] if lock > 0 else g[rows + 2, k])
    branches = rows == at.H_LEAST and m.flags[at.BRANCHED, k] != 0
    turns = least < 0.0 < most and not branches
    g[at.CLEARANCE, k] = low if turns else inf
    g[at.H, k] = high - low
    if low > 0.0:
        return CLEAR
    ga = facing(lock, g[left, k])
    da = facing(lock, g[left + 1, k])
    gz = facing(lock, g[right, k])
    dz = facing(lock, g[right + 1, k])
    noise = blur(g[at.SIZE, k], da, resolution)
    on = is_on(ga, da, noise)
    past = is_past_at(p, m, k, right, dt, resolution)
    if on:
        g[at.CLEARANCE, k] = inf
        past = past and not is_leaving(m, k, dz, z * dt, resolution)
    # A rate that moves h by no more than its rounding, over the piece, counts as zero.
    still = STILL * max(abs(low), abs(high)) / ((z - a) * dt)
    still = still if still < inf else 0.0
    falls = most <= still and not branches
    rises = least >= -still and not branches
    if past and falls:
        g[at.CLEARANCE, k] = FALLS
        return FLIPS
    if not past and (falls or (rises and (on or gz > 0.0))):
        return CLEAR
    if on:
        rest = RESTS_WITHIN * noise
        if low >= -rest and high <= rest:
            return FLIPS if past else CLEAR
    elif ga > 0.0 and gz > 0.0 and not branches:
        doubt = END_ROUNDING * max(abs(low), abs(high))
        bound = lowest(ga - doubt, gz - doubt, least, most, (z - a) * dt)
        if bound > 0.0:
            g[at.CLEARANCE, k] = bound if turns else inf
            return CLEAR
    g[at.CLEARANCE, k] = inf
    if low >= -g[at.GRAIN, k] and high <= g[at.GRAIN, k]:
        return MAY_BE_ZERO
    if on:
        m.clock[at.CUT] = min(m.clock[at.CUT], LEAVING)
    return DIVIDE


@kernel
def rests(p: Problem, m: Memory, k: int, row: int, resolution: float) -> bool:
    """Return whether guard k is on its surface by the values in a row."""
    g = facing(p.mode[k], m.guards[row, k])
    d = facing(p.mode[k], m.guards[row + 1, k])
    return is_on(g, d, blur(m.guards[at.SIZE, k], d, resolution))


@kernel
def judge_by_signs(
    p: Problem, m: Memory, k: int, right: int, dt: float, z: float
) -> int:
    """Judge guard k, which is not past its surface before a piece, by its end."""
    g = m.guards
    resolution = time_resolution(m.clock[at.T], dt)
    gz = facing(p.mode[k], g[right, k])
    dz = facing(p.mode[k], g[right + 1, k])
    past = is_past_at(p, m, k, right, dt, resolution)
    if past and not (gz < 0.0 and is_leaving(m, k, dz, z * dt, resolution)):
        return FLIPS
    return CLEAR


@kernel
def comes_from_flip(m: Memory, k: int) -> bool:
    """Return whether guard k has just flipped, where a step begins whose proof is open.

    The ranges of states, which are wider than the states by rounding, still reach back
    across a jump there.
    """
    begins = m.clock[at.T] == m.clock[at.INSTANT]
    return m.counts[at.FROM_START] != 0 and begins and has_flipped(m, k)


@kernel_apart
def judge_near(  # noqa: PLR0913 (a piece, its ends and its rows, in a compiled loop)
    p: Problem, m: Memory, rows: int, left: int, right: int, dt: float, a: float,
    z: float, is_last: bool, by_grain: bool,
) -> int:  # fmt: skip
    """Judge the guards in NEAR in a piece, and return the verdict.

    If `is_last`, the piece is not divided any more: signs decide, and DOUBT says so.
    If `by_grain`, the grains of the guards are those in this piece. If some flip and
    none is undecided, NEAR receives those that flip.
    """
    resolution = time_resolution(m.clock[at.T], dt)
    flipping = 0
    for i in range(m.counts[at.N_NEAR]):
        k = m.lists[at.NEAR, i]
        verdict = judge(p, m, k, rows, left, right, dt, a, z, resolution)
        if verdict == MAY_BE_ZERO:
            if not by_grain:
                return MAY_BE_ZERO
            m.counts[at.UNSURE] |= 0 if rests(p, m, k, left, resolution) else 1
            # What is zero to within rounding has no sign that counts.
            size = m.guards[at.GRAIN, k] / ROUNDING
            m.guards[at.SIZE, k] = max(m.guards[at.SIZE, k], size)
            verdict = CLEAR
        elif verdict == DIVIDE:
            if not is_last:
                return DIVIDE
            verdict = judge_by_signs(p, m, k, right, dt, z)
            if verdict == CLEAR:
                doubt = EXCUSED if comes_from_flip(m, k) else DOUBTED
                m.counts[at.DOUBT] = max(m.counts[at.DOUBT], doubt)
        if verdict == FLIPS:
            # NEAR is written over from its start: what was read is not needed again.
            m.lists[at.NEAR, flipping] = k
            flipping += 1
    if flipping == 0:
        return CLEAR
    m.counts[at.N_NEAR] = flipping
    return FLIPS


# What rounding and the tolerance make of a guard, from its slopes by the states.


@kernel_apart
def vary(
    p: Problem, m: Memory, dt: float, a: float, z: float, by_tolerance: bool
) -> None:
    """Write the guards' rates if each state moves by its tolerance, or by its own size.

    They are written to RANGES + 2 and RANGES + 3. In the second case, time moves by
    its size, too. The slopes of the states are overwritten.
    """
    s = m.states
    m.counts[at.ARE_WHOLE] = 0
    for i in range(s.width):
        size = max(abs(s[at.LEAST, i]), abs(s[at.MOST, i]))
        reach = size
        if by_tolerance:
            reach = INTERPOLANT * (p.atol[i] + p.rtol * size)
        s[at.LEAST_SLOPE, i] = -reach
        s[at.MOST_SLOPE, i] = reach
    start = m.clock[at.T] + a * dt
    end = m.clock[at.T] + z * dt
    answer_next(m, 0)
    run_once(p, m, start, end, 0.0 if by_tolerance else max(abs(start), abs(end)))


@kernel
def reach_of(m: Memory, k: int) -> float:
    """Return the largest rate of guard k, either way, in the last run."""
    return max(-m.guards[at.RANGES + 2, k], m.guards[at.RANGES + 3, k])


@kernel_apart
def set_grains(p: Problem, m: Memory, dt: float, a: float, z: float) -> None:
    """Write what the guards may be by rounding alone; 0 where that is not known."""
    vary(p, m, dt, a, z, False)
    for i in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, i)
        grain = GRAIN * reach_of(m, k)
        m.guards[at.GRAIN, k] = grain if grain < inf else 0.0


@kernel_apart
def forget_grains(p: Problem, m: Memory) -> None:
    """Let no value of a guard count as rounding alone."""
    for i in range(m.counts[at.N_AWAKE]):
        m.guards[at.GRAIN, awake(p, m, i)] = 0.0


@kernel
def any_turns_near(m: Memory) -> bool:
    """Return whether a clear guard in NEAR turns back not far from its surface."""
    candidates = 0
    for i in range(m.counts[at.N_NEAR]):
        k = m.lists[at.NEAR, i]
        is_near = m.guards[at.CLEARANCE, k] <= NEARLY * m.guards[at.H, k]
        candidates += 1 if is_near else 0
    return candidates > 0


@kernel_apart
def any_close(
    p: Problem, m: Memory, dt: float, a: float, z: float, may_divide: bool
) -> bool:
    """Note in IS_CLOSE if clear guards in NEAR turn closer than the tolerance can tell.

    Returns whether the piece should be divided, because their distance is not known
    well enough.
    """
    g = m.guards
    if not any_turns_near(m):
        return False
    vary(p, m, dt, a, z, True)
    found = 0
    for i in range(m.counts[at.N_NEAR]):
        k = m.lists[at.NEAR, i]
        reach = reach_of(m, k)
        if g[at.CLEARANCE, k] <= reach < inf:
            if may_divide and g[at.H, k] > SHARP * reach:
                return True
            found += 1
    if found > 0:
        m.counts[at.IS_CLOSE] = 1
    return False


# The step, from left to right.


@kernel
def expected_change(m: Memory) -> float:
    """Return where the first open comparison or jump is expected, or -1.

    The place is a fraction of the piece.
    """
    c = m.counts
    if c[at.ANSWERS + answers.OPENED] + c[at.ANSWERS + answers.JUMPED] == 0:
        return -1.0
    note = float_vector(address_of(c) + BYTES * at.ANSWERS, answers.N_SLOTS)
    low = note[answers.FIRST_LEAST]
    high = note[answers.FIRST_MOST]
    if not low < 0.0 < high:
        return -1.0
    if note[answers.FIRST_LEAST_RATE] > 0.0:
        return -low / (high - low)
    if note[answers.FIRST_MOST_RATE] < 0.0:
        return high / (high - low)
    return -1.0


@kernel
def set_place_to_divide(m: Memory, width: float, shortest: float) -> None:
    """Write the part of the piece before the expected change, and that around it.

    They are written to CUT and AROUND. The second is 0 where the piece is halved.
    """
    x = expected_change(m)
    band = max(BAND, shortest / width)
    m.clock[at.CUT] = 0.5
    m.clock[at.AROUND] = 0.0
    if x >= 0.0 and band <= WIDEST_BAND:
        first = max(x - band, band)
        m.clock[at.CUT] = first
        m.clock[at.AROUND] = min(x + band, 1.0 - band) - first


@kernel
def spare(row: int) -> int:
    """Return the rows for the guards at a place inside the step that are not `row`."""
    return at.H_RIGHT if row == at.H_LEFT else at.H_LEFT


@kernel_apart
def examine(
    p: Problem, m: Memory, dt: float, a: float, z: float, left: int, shortest: float
) -> tuple[int, int]:
    """Judge a piece; return the verdict, and the rows of the guards at its end.

    The rows are -1 if the guards have not been evaluated there. KNOWN says whether they
    have been at its start, in the rows `left`. CUT and AROUND say where to divide it.
    """
    width = z - a
    by_grain = False
    m.counts[at.DOUBT] = 0
    while True:
        m.counts[at.LOOKS] += 1
        rows = look_over(p, m, dt, a, z)
        # Before a closer look overwrites the answers.
        set_place_to_divide(m, width, shortest)
        if gather_near(p, m, rows) == 0:
            return CLEAR, -1
        if m.counts[at.KNOWN] == 0:
            look(p, m, dt, a, left)
            m.counts[at.KNOWN] = 1
        right = at.H1
        if z < 1.0:
            right = spare(left)
            if not by_grain:
                look(p, m, dt, z, right)
        is_last = width <= shortest
        verdict = judge_near(p, m, rows, left, right, dt, a, z, is_last, by_grain)
        if verdict != MAY_BE_ZERO:
            break
        set_grains(p, m, dt, a, z)
        by_grain = True
    if verdict == CLEAR and any_close(p, m, dt, a, z, width > SHORTEST_IF_CLOSE):
        m.clock[at.CUT] = 0.5
        m.clock[at.AROUND] = 0.0
        return DIVIDE, right
    return verdict, right


@kernel
def first_piece(m: Memory, dt: float, shortest: float) -> float:
    """Return the part of the step that is judged first.

    It is about as long as what could be judged at once in the last steps.
    """
    if 2.0 * m.clock[at.PIECE] > dt:
        return 1.0
    return max(m.clock[at.PIECE] / dt, shortest)


@kernel
def next_piece(z: float, width: float, around: float, is_doubted: bool) -> float:
    """Return the end of the piece after a clear one, which ends at `z`."""
    if around > 0.0:
        return min(z + around, 1.0)
    longer = (GROW_MUCH if width < VERY_SHORT else GROW) * width
    if is_doubted:
        longer = 2.0 * width
    return z + longer if z + 1.25 * longer < 1.0 else 1.0


@kernel
def settle_doubt(m: Memory, a: float, z: float, shortest: float, flips: bool) -> float:
    """Count what only signs have decided, after a piece that is not divided.

    Returns the length of the shortest piece from here on: it doubles from piece to
    piece as long as nothing is proven. Where a guard flips in the end, the doubt about
    the pieces before has gone, if they are short.
    """
    c = m.counts
    if c[at.DOUBT] == EXCUSED and z > SURE * shortest:
        c[at.DOUBT] = DOUBTED
    if c[at.DOUBT] == 0:
        is_short = z - m.clock[at.DOUBT_AT] <= SURE * shortest
        if not (flips and is_short):
            c[at.UNSURE] |= c[at.PENDING]
        c[at.PENDING] = 0
        c[at.FROM_START] = 0
        return shortest
    if c[at.DOUBT] == DOUBTED:
        if c[at.PENDING] == 0:
            m.clock[at.DOUBT_AT] = a
        c[at.PENDING] = 1
    return max(2.0 * (z - a), shortest)


@kernel
def begin_proof(m: Memory) -> None:
    """Forget what was known of the last step."""
    m.counts[at.UNSURE] = 0
    m.counts[at.PENDING] = 0
    m.counts[at.FROM_START] = 1
    m.counts[at.KNOWN] = 1
    m.counts[at.IS_CLOSE] = 0


@kernel_apart
def proven_flip(p: Problem, m: Memory, dt: float) -> Found:
    """Return the first flip within the step, by proof as far as the budget goes."""
    begin_proof(m)
    shortest = max(SHORTEST * time_resolution(m.clock[at.T], dt) / dt, FINEST)
    least = shortest  # length of a piece that is not divided
    a = 0.0
    z = first_piece(m, dt, shortest)
    left = at.H0
    around = 0.0  # length of the next piece, around an expected change; 0: none
    halve = False  # this piece is beside an expected change: it is not cut around one
    has_passed = False  # this piece is around an expected change
    has_grains = False
    for _ in range(max(MOST_LOOKS >> m.counts[at.EXHAUSTED], LEAST_LOOKS)):
        verdict, right = examine(p, m, dt, a, z, left, least)
        width = z - a
        if verdict == DIVIDE:
            if not has_grains and width <= DOUBTFUL:
                set_grains(p, m, dt, a, z)
                has_grains = True
            cut = min(m.clock[at.CUT], 0.5) if halve else m.clock[at.CUT]
            around = 0.0 if halve else m.clock[at.AROUND] * width
            halve = around > 0.0
            z = a + cut * width
            continue
        if width > VERY_SHORT:
            m.clock[at.PIECE] = GROW * width * dt
        jumps = width <= least
        least = settle_doubt(m, a, z, shortest, verdict == FLIPS)
        if verdict == FLIPS:
            k, theta = first_root(p, m, dt, a, z, right)
            if not jumps:  # beside a pole, values are no measure of rounding
                set_sizes(p, m, left, right)
            end_proof(p, m, has_grains)
            return k, theta, jumps
        if z >= 1.0:
            return end_proof(p, m, has_grains)
        left = spare(left) if right < 0 else right
        m.counts[at.KNOWN] = 1 if right >= 0 else 0
        a = z
        begin_pieces(m)
        halve = has_passed
        has_passed = around > 0.0
        z = next_piece(a, width, around, m.counts[at.DOUBT] != 0)
        around = 0.0
    m.counts[at.EXHAUSTED] += 1
    m.counts[at.PENDING] = 1
    end_proof(p, m, has_grains)
    return sampled_flip(p, m, dt, a)


@kernel
def end_proof(p: Problem, m: Memory, has_grains: bool) -> Found:
    """Count the step if it is not proven or close, and return that no guard flips."""
    m.counts[at.UNPROVEN] += m.counts[at.UNSURE] | m.counts[at.PENDING]
    m.counts[at.CLOSE] += m.counts[at.IS_CLOSE]
    if has_grains:
        forget_grains(p, m)
    return NONE, 1.0, False


@kernel
def set_sizes(p: Problem, m: Memory, left: int, right: int) -> None:
    """Set the rounding scale of guards in NEAR by their values at two places."""
    g = m.guards
    for a in range(m.counts[at.N_NEAR]):
        k = m.lists[at.NEAR, a]
        # What counts as rounding remains so until the guard has left its surface.
        has_left = facing(p.mode[k], g[at.H0, k]) > 0.0
        size = max(abs(g[left, k]), abs(g[right, k]))
        g[at.SIZE, k] = max(size, g[at.PARTS if has_left else at.SIZE, k])


@kernel_apart
def sampled_flip(p: Problem, m: Memory, dt: float, begin: float) -> Found:
    """Return the first flip after the fraction `begin` of the step, by samples."""
    part = min(1.0 / SAMPLES, (p.t_end - p.t_start) / (SAMPLES_OF_RUN * dt))
    parts = int((1.0 - begin) / part) + 1
    a = begin
    for j in range(1, parts + 1):
        z = begin + (1.0 - begin) * (j / parts)
        right = at.H1
        if j < parts:
            right = at.H_RIGHT
            look(p, m, dt, z, right)
        count = 0
        for i in range(m.counts[at.N_AWAKE]):
            k = awake(p, m, i)
            if judge_by_signs(p, m, k, right, dt, z) == FLIPS:
                m.lists[at.NEAR, count] = k
                count += 1
        m.counts[at.N_NEAR] = count
        if count > 0:
            k, theta = first_root(p, m, dt, a, z, right)
            set_sizes(p, m, at.H0, right)
            return k, theta, False
        a = z
    return NONE, 1.0, False


@kernel_apart
def verdict_ahead(p: Problem, m: Memory, dt: float) -> int:
    """Judge the whole step by ranges over several steps; DIVIDE if they do not tell.

    What wider ranges show, those of the step show as well. So the verdict is that of
    `examine` wherever there is one.
    """
    if not knows_box(p, m, dt):
        return DIVIDE
    if gather_near(p, m, at.BOX_RANGES) == 0:
        return CLEAR
    verdict = judge_near(
        p, m, at.BOX_RANGES, at.H0, at.H1, dt, 0.0, 1.0, False, False
    )  # fmt: skip
    if verdict == FLIPS or (verdict == CLEAR and not any_turns_near(m)):
        return verdict
    reach_less(m)
    return DIVIDE


@kernel_in_loop
def first_flip(p: Problem, m: Memory, dt: float) -> Found:
    """Return the first flip within the step."""
    if m.counts[at.N_AWAKE] == 0:
        return NONE, 1.0, False
    if p.branches <= 0:
        prepare_interpolant(p, m, dt)
        m.counts[at.UNPROVEN] += 1
        return sampled_flip(p, m, dt, 0.0)
    prepare_interpolant(p, m, dt)
    begin_enclosing(p, m)
    # Guards that sleep have no ranges; those that are left out have them over another
    # box, which takes the same rows.
    all_are_asked = p.rate_bound == 0 and p.rules[at.LEAVES_OUT, 0] == 0
    # Where pieces of this length were divided, longer ones will be.
    if all_are_asked and first_piece(m, dt, 0.0) == 1.0:
        verdict = verdict_ahead(p, m, dt)
        if verdict != DIVIDE:
            m.clock[at.PIECE] = GROW * dt
            if verdict == CLEAR:
                return NONE, 1.0, False
            k, theta = first_root(p, m, dt, 0.0, 1.0, at.H1)
            set_sizes(p, m, at.H0, at.H1)
            return k, theta, False
    return proven_flip(p, m, dt)
