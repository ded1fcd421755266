"""Known instants: where a step ends because the field jumps there, and the next begins.

Some are declared: single ones, and periodic ones. Others are found. If the field's
code compares the time, or jumps or has a kink in it, the code for ranges
(`numbers.switches`) is run over the time ahead, with states and rates of states
unknown. What jumps there and has a known rate depends on the time alone. From left to
right, a stretch of time is clear, or it is divided before the place where a jump is
expected, until what remains is as short as rounding. Stretches that are clear need not
be looked at again, unless an event changes parameters or the mode. Where the source of
the field shows that the mode does not matter (`numbers.modes`), only parameters do.

Between two instants, the field sees only times of this piece: its time is held within
two limits, the last two numbers of the parameters (see `derived.with_instants`). They
leave out what rounding may put on the other side. So all stages of a step, also
that at its end, are evaluated on the side to which they belong, however the field
compares.
"""

from math import floor, inf

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.compiled.memory import FloatVector, address_of, float_vector
from hopdata.hybrid.driver.paths import BYTES, MOST_RUNS, answer_next, call_ranges
from hopdata.hybrid.driver.problem import (
    EPS,
    TIME_ROUNDING,
    Problem,
    time_resolution,
)
from hopdata.hybrid.layout import Memory
from hopdata.hybrid.numbers import answers

#: Length of the shortest stretch of time that is divided, in which a jump is located.
#: Unit: time resolutions. Origin: rounding: `t % T` and `sin(w t)` err by some two
#: units in the last place of the time, to either side.
SHORTEST = 2.0

#: Length of a stretch of time that is not divided, even where it begins at t = 0.
#: Unit: s. Origin: derived: 900 halvings of a second, well within `MOST_LOOKS`, where
#: each second look halves a stretch.
TINIEST = 2.0**-900

#: Times that a stretch with a jump is made twice as long, if the jump is not over.
#: Unit: 1. Origin: chosen.
MOST_WIDER = 10

#: How far ahead jumps are sought, in steps, at first.
#: Unit: 1. Origin: chosen.
AHEAD = 4.0

#: Factor by which the stretch after a clear one is longer, and by which jumps are
#: sought farther ahead after a search without a find.
#: Unit: 1. Origin: chosen.
GROW = 4.0

#: Stretches that are looked at in one search; the next steps are not searched then.
#: Unit: 1. Origin: chosen.
MOST_LOOKS = 4096

#: Longest step that may follow, in steps as proposed.
#: Unit: 1. Origin: derived: `stepping.ALMOST_THERE` stretches a step by a hundredth.
STRETCH = 1.02

#: Largest part of the time up to a declared instant that is left out before it, because
#: the field may compute this instant with another rounding.
#: Unit: 1. Origin: chosen.
MOST_MARGIN = 0.125


# The limits between which the field sees the time.


@kernel
def set_limits(p: Problem, first: float, last: float) -> None:
    """Let the field see times from `first` to `last` only."""
    n = p.params.width
    p.params[n - 2] = first
    p.params[n - 1] = last


@kernel
def first_time(p: Problem) -> float:
    """Return the first time that the field sees in this piece."""
    return p.params[p.params.width - 2]


# Declared instants.


@kernel
def next_periodic(first: float, period: float, t: float) -> float:
    """Return the next of the instants first + k period after time t, k being whole."""
    k = floor((t - first) / period) + 1.0
    found = first + k * period
    if found > t:
        return found
    return first + (k + 1.0) * period


@kernel
def next_declared(p: Problem, m: Memory, t: float) -> float:
    """Return the next declared instant after time t; infinity if there is none."""
    place = m.counts[at.NEXT_SINGLE]
    while place < p.singles.width and p.singles[place] <= t:
        place += 1
    m.counts[at.NEXT_SINGLE] = place
    found = inf
    if place < p.singles.width:
        found = p.singles[place]
    for i in range(0, p.periods.width, 2):
        found = min(found, next_periodic(p.periods[i], p.periods[i + 1], t))
    return found


@kernel
def aim(p: Problem, m: Memory, t: float, first: float) -> None:
    """Aim at the next declared instant after time t.

    In this piece, the field sees times from `first` on.
    """
    stop = next_declared(p, m, t + time_resolution(t, 0.0))
    m.clock[at.STOP] = stop
    m.clock[at.AFTER_STOP] = stop
    last = stop
    if stop < inf:
        # The field may compute the time of its jump from numbers as large as these.
        size = max(abs(stop), abs(p.t_start), abs(p.t_end))
        margin = min(TIME_ROUNDING * size, MOST_MARGIN * (stop - t))
        last = max(stop - margin, first)
        m.clock[at.AFTER_STOP] = stop + margin
    m.clock[at.BEFORE_STOP] = last
    set_limits(p, first, last)


@kernel_apart
def begin_piece(p: Problem, m: Memory) -> None:
    """Aim at the first instant of an integration; one at its start has passed."""
    t = p.t_start
    reach = TIME_ROUNDING * max(abs(t), abs(p.t_end))
    m.counts[at.NEXT_SINGLE] = 0
    m.clock[at.SOUGHT] = t
    m.clock[at.SEEK_LENGTH] = 0.0
    m.clock[at.LOOK_LENGTH] = inf
    first = -inf
    if next_declared(p, m, t - 2.0 * reach) <= t + reach:
        first = t + reach
        m.clock[at.SOUGHT] = first
    m.counts[at.NEXT_SINGLE] = 0
    aim(p, m, t, first)


@kernel
def begin(p: Problem, m: Memory) -> None:
    """Begin an integration."""
    m.clock[at.STOP] = inf
    if p.has_stops != 0:
        begin_piece(p, m)


@kernel
def sought_with(p: Problem) -> FloatVector:
    """Return the place for the parameters with which jumps were sought last."""
    n = p.params.width
    before = 2 * (p.mode.width + n) + n
    return float_vector(address_of(p.kept) + BYTES * before, n)


@kernel_apart
def keep_parameters(p: Problem) -> None:
    """Keep the parameters with which jumps are sought."""
    kept = sought_with(p)
    for i in range(p.params.width - 2):
        kept[i] = p.params[i]


@kernel_apart
def are_as_sought(p: Problem, m: Memory) -> bool:
    """Return whether the jumps that were found, or not found, hold after an event.

    They do if nothing on which they depend can have changed.
    """
    if p.has_stops != at.STOPS_IN_ALL_MODES or m.counts[at.BY_STATE] != 0:
        return False
    if p.n_varying < m.states.width:  # some parameters are states
        return False
    kept = sought_with(p)
    changed = 0
    for i in range(p.params.width - 2):
        changed += 0 if kept[i] == p.params[i] else 1
    return changed == 0


@kernel_apart
def seek_anew(p: Problem, m: Memory) -> None:
    """Forget the jumps that were found, if an event may have changed the field."""
    if are_as_sought(p, m):
        return
    t = m.clock[at.T]
    m.clock[at.SEEK_LENGTH] = 0.0
    m.clock[at.SOUGHT] = max(t, first_time(p))
    if m.clock[at.STOP] - t > time_resolution(t, 0.0):
        aim(p, m, t, first_time(p))


# Jumps of the field in time.


@kernel_apart
def set_states(p: Problem, m: Memory, is_known: bool) -> None:
    """Write the ranges of the states and of their rates.

    If `is_known`, the states are those of now; otherwise they may be any numbers. Their
    rates may be any in both cases. From state `n_varying` on, the states are
    parameters: they are known, and do not vary.
    """
    s = m.states
    for i in range(s.width):
        varies = i < p.n_varying
        is_wide = varies and not is_known
        s[at.LEAST, i] = -inf if is_wide else s[at.Y, i]
        s[at.MOST, i] = inf if is_wide else s[at.Y, i]
        s[at.LEAST_SLOPE, i] = -inf if varies else 0.0
        s[at.MOST_SLOPE, i] = inf if varies else 0.0


@kernel
def run_field(p: Problem, m: Memory, start: float, end: float) -> None:
    """Run the field's code for ranges over a stretch of time.

    The stretch overlaps the next one by a rounding: a kink exactly between them is in
    none otherwise.
    """
    if end < min(p.t_end, m.clock[at.BEFORE_STOP]):
        end += EPS * max(abs(start), abs(end))
    n = m.states.width
    states = address_of(m.states)
    call_ranges(
        p.switches, start, end, 1.0,
        states + BYTES * n * at.LEAST, states + BYTES * n * at.LEAST_SLOPE, n,
        address_of(p.mode), p.mode.width, address_of(p.params), p.params.width - 2,
        0, 0, 0, 0, address_of(m.counts) + BYTES * at.ANSWERS,
    )  # fmt: skip


@kernel_apart
def jumps_on_paths(p: Problem, m: Memory, start: float, end: float) -> int:
    """Return 1 if the field jumps in time on one of its paths, and 0 if on none.

    The result is -1 if there are too many paths, or if one could not be followed.
    """
    c = m.counts
    c[at.ANSWERS + answers.TIMED] = 0
    bits = 0
    for _ in range(MOST_RUNS):
        answer_next(m, bits)
        run_field(p, m, start, end)
        if c[at.ANSWERS + answers.TIMED] > 0:
            return 1
        opened = c[at.ANSWERS + answers.OPENED]
        if opened > answers.N_ANSWERS or c[at.ANSWERS + answers.LOST] != 0:
            return -1
        bits = answers.next_answers(bits, opened)
        if bits < 0:
            return 0
    return -1


@kernel_apart
def may_jump(p: Problem, m: Memory, start: float, end: float) -> bool:
    """Return whether the field may jump in time within a stretch.

    Where its paths cannot all be followed, those at the present state count.
    """
    found = jumps_on_paths(p, m, start, end)
    if found < 0:
        m.counts[at.BY_STATE] = 1
        set_states(p, m, True)
        found = jumps_on_paths(p, m, start, end)
        set_states(p, m, False)
    return found > 0


@kernel
def expected_place(m: Memory, start: float, end: float) -> float:
    """Return when the jump that was noted first is expected, or infinity."""
    memory = address_of(m.counts) + BYTES * at.ANSWERS
    note = float_vector(memory, answers.N_SLOTS)
    low = note[answers.TIMED_LEAST]
    high = note[answers.TIMED_MOST]
    if not low <= 0.0 <= high or not low < high or high - low == inf:
        return inf
    if note[answers.TIMED_LEAST_RATE] > 0.0:
        return start - low / (high - low) * (end - start)
    if note[answers.TIMED_MOST_RATE] < 0.0:
        return start + high / (high - low) * (end - start)
    return inf


@kernel
def near_reach(p: Problem, m: Memory) -> float:
    """Return how far ahead jumps are sought at first, s."""
    return AHEAD * min(m.clock[at.NEXT_DT], p.max_step)


@kernel_apart
def give_up(p: Problem, m: Memory, a: float, goal: float) -> None:
    """Leave some steps from time `a` on, up to `goal`, without a search; count it."""
    m.counts[at.UNSOUGHT] += 1
    m.clock[at.SOUGHT] = min(a + near_reach(p, m), goal)
    m.clock[at.SEEK_LENGTH] = 0.0


@kernel_apart
def note_jump(
    p: Problem, m: Memory, start: float, end: float, place: float, goal: float
) -> None:
    """Let the next step end at a jump that is located between two times.

    It is one if the field does not jump directly after it, or after a longer stretch.
    Otherwise no single instant can be told.
    """
    width = end - start
    least = SHORTEST * TIME_ROUNDING * max(abs(p.t_start), abs(p.t_end))
    wider = 0
    while wider < MOST_WIDER:
        if not may_jump(p, m, end, end + width):
            if not start <= place <= end:
                place = 0.5 * (start + end)
            m.clock[at.STOP] = place
            m.clock[at.BEFORE_STOP] = start
            m.clock[at.AFTER_STOP] = end
            m.clock[at.SOUGHT] = end
            set_limits(p, first_time(p), start)
            return
        end += width
        width *= 2.0
        # Near t = 0 the numbers from which the field computes the jump may be larger.
        wider += 1 if end - start > least else 0
    give_up(p, m, end, goal)


@kernel
def length_of_shortest(t: float, a: float, z: float) -> float:
    """Return the length of a stretch from `a` to `z` that is not divided, at time t."""
    return max(SHORTEST * TIME_ROUNDING * max(abs(a), abs(z), z - t), TINIEST)


@kernel_apart
def seek(p: Problem, m: Memory, goal: float) -> None:
    """Look for the first jump of the field up to time `goal`."""
    set_states(p, m, False)
    keep_parameters(p)
    a = m.clock[at.SOUGHT]
    t = m.clock[at.T]
    begin = a
    z = goal
    if m.clock[at.LOOK_LENGTH] < goal - a:
        shortest = length_of_shortest(t, a, a + m.clock[at.LOOK_LENGTH])
        z = min(a + max(m.clock[at.LOOK_LENGTH], shortest), goal)
    opens = z  # end of a stretch that may jump; not after a: none
    then = z  # end of the next stretch, if this one is clear
    place = inf
    halve = False
    for _ in range(MOST_LOOKS):
        shortest = length_of_shortest(t, a, z)
        if not may_jump(p, m, a, z):
            a = z
            if a >= goal:
                m.clock[at.SOUGHT] = goal
                m.clock[at.LOOK_LENGTH] = max(m.clock[at.LOOK_LENGTH], a - begin)
                m.clock[at.SEEK_LENGTH] = GROW * (goal - t)
                return
            if a < then:
                z = then
            elif a < opens:
                z = opens
            else:
                z = min(a + GROW * (a - begin), goal)
            then = z
            continue
        width = z - a
        found = expected_place(m, a, z)
        if found < inf:
            place = found
        if width <= 1.5 * shortest:
            m.clock[at.LOOK_LENGTH] = GROW * max(a - begin, shortest)
            m.clock[at.SEEK_LENGTH] = 0.0
            note_jump(p, m, a, z, place, goal)
            return
        opens = z
        then = z
        cut = a + 0.5 * width
        if found < inf and not halve:
            cut = found - 0.5 * shortest
            then = found + 0.5 * shortest
        halve = not halve
        z = min(max(cut, a + shortest), a + max(0.75 * width, width - shortest))
        then = min(max(then, z), opens)
    give_up(p, m, a, goal)


@kernel
def look_ahead(p: Problem, m: Memory) -> None:
    """Look for a jump of the field in the next steps, unless that is done.

    As long as none is found, it is looked for farther and farther ahead.
    """
    t = m.clock[at.T]
    last = min(p.t_end, m.clock[at.BEFORE_STOP])
    dt = min(m.clock[at.NEXT_DT], p.max_step)
    if m.clock[at.SOUGHT] < min(last, t + STRETCH * dt):
        reach = max(near_reach(p, m), m.clock[at.SEEK_LENGTH])
        seek(p, m, min(last, t + reach))


@kernel_apart
def meet(p: Problem, m: Memory) -> bool:
    """Begin the piece after an instant that is reached; return whether one is.

    Otherwise the next one is sought.
    """
    t = m.clock[at.T]
    resolution = time_resolution(t, 0.0)
    if m.clock[at.STOP] - t > resolution and p.switches > 0:
        look_ahead(p, m)
    if m.clock[at.STOP] - t > resolution:
        return False
    m.counts[at.N_STOPS] += 1
    m.clock[at.PASSED] = min(m.clock[at.PASSED], m.clock[at.BEFORE_STOP])
    first = max(first_time(p), m.clock[at.AFTER_STOP])
    m.clock[at.SOUGHT] = max(m.clock[at.SOUGHT], first)
    aim(p, m, max(t, m.clock[at.STOP]), first)
    return True
