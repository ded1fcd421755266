"""Guards that cannot flip for a while sleep, so that a step spends nothing on them.

No event function changes faster than the scene's rate bound. A guard can therefore
sleep until the travel, the integral of the bound over time, has used up its distance
from the surface. The sleeping guards form a heap, ordered by the travel at which they
must wake.

Many guards that are declared together have no such bound and are always evaluated, but
their ranges, which cost far more, are not: where a guard is clear of its surface in a
box around the present piece of a step, it is left out until the trajectory leaves the
box. Its ranges are those over the box, which are wider and as true.
"""

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import call_rate_bound, kernel, kernel_apart
from hopdata.hybrid.driver.problem import Problem, eval_guard
from hopdata.hybrid.layout import Memory

# The heap of sleeping guards: the one that must wake first is at the top.
#
# Each node has four children, side by side. This makes the heap flat, and the least of
# four is found without branches that a processor would have to predict.

WIDTH = 4  # children of a node


@kernel
def put(m: Memory, node: int, k: int, wake_at: float) -> None:
    """Put guard k at a node of the heap."""
    m.lists[at.HEAP, node] = k
    m.wake_at[node] = wake_at


@kernel
def push(m: Memory, k: int, wake_at: float) -> None:
    """Put guard k into the heap."""
    node = m.counts[at.N_ASLEEP]
    m.counts[at.N_ASLEEP] += 1
    while node > 0:
        above = (node - 1) // WIDTH
        if m.wake_at[above] <= wake_at:
            break
        put(m, node, m.lists[at.HEAP, above], m.wake_at[above])
        node = above
    put(m, node, k, wake_at)


@kernel
def least_below(m: Memory, first: int, size: int) -> int:
    """Return the node that must wake first, of up to four from `first` on."""
    w = m.wake_at
    if first + WIDTH <= size:
        # A tournament of four, whose additions need no branches.
        left = first + (1 if w[first + 1] < w[first] else 0)
        right = first + 2 + (1 if w[first + 3] < w[first + 2] else 0)
        return right if w[right] < w[left] else left
    least = first
    for node in range(first + 1, size):
        if w[node] < w[least]:
            least = node
    return least


@kernel
def replace_first(m: Memory, k: int, wake_at: float) -> None:
    """Replace the guard at the top of the heap by guard k."""
    size = m.counts[at.N_ASLEEP]
    node = 0
    below = 1  # first of its children
    while below < size:
        least = least_below(m, below, size)
        if wake_at <= m.wake_at[least]:
            break
        put(m, node, m.lists[at.HEAP, least], m.wake_at[least])
        node = least
        below = WIDTH * least + 1
    put(m, node, k, wake_at)


@kernel
def pop(m: Memory) -> int:
    """Remove the guard that must wake first from the heap, and return it."""
    first = m.lists[at.HEAP, 0]
    m.counts[at.N_ASLEEP] -= 1
    last = m.counts[at.N_ASLEEP]
    if last > 0:
        replace_first(m, m.lists[at.HEAP, last], m.wake_at[last])
    return first


#: Factor by which the rate bound within a step may exceed that at its ends and middle.
#: Unit: 1. Origin: chosen.
MARGIN = 1.25

#: Distance at which a guard goes to sleep, in the travel of steps like the last one.
#: Unit: 1. Origin: chosen.
SLEEPS_FROM = 4.0


@kernel
def speed_at(p: Problem, m: Memory, t: float, y: int, dy: int) -> float:
    """Return the bound on all rates at a row of the states; 0 if there is none."""
    if p.rate_bound == 0:
        return 0.0
    s = m.states
    return abs(call_rate_bound(p.rate_bound, t, s, y, s, dy, p.mode, p.params))


@kernel
def step_travel(p: Problem, m: Memory, dt: float) -> float:
    """Return the travel of the step from Y to END, by the bound at its ends and middle.

    The middle is evaluated on the cubic through states and slopes at both ends.
    """
    s = m.states
    t = m.clock[at.T]
    for i in range(s.width):
        rise = s[at.END, i] - s[at.Y, i]
        bulge = 0.125 * dt * (s[at.K1, i] - s[at.KEND, i])
        s[at.SCRATCH, i] = s[at.Y, i] + 0.5 * rise + bulge
        s[at.SLOPE, i] = 1.5 * rise / dt - 0.25 * (s[at.K1, i] + s[at.KEND, i])
    middle = speed_at(p, m, t + 0.5 * dt, at.SCRATCH, at.SLOPE)
    end = speed_at(p, m, t + dt, at.END, at.KEND)
    return MARGIN * dt * max(m.clock[at.SPEED], middle, end)


@kernel
def wake_first(p: Problem, m: Memory, limit: float) -> int:
    """Wake the guard that must wake first, unless it is beyond the travel `limit`.

    Returns its number, or -1 if it sleeps on.
    """
    k = m.lists[at.HEAP, 0]
    m.counts[at.NGEV] += 1
    eval_guard(p, m, m.clock[at.T], at.Y, at.K1, k, at.H0, at.RATE0)
    distance = abs(m.guards[at.H0, k])
    if m.clock[at.TRAVEL] + distance > limit:
        replace_first(m, k, m.clock[at.TRAVEL] + distance)
        return -1
    m.guards[at.SIZE, k] = distance
    m.guards[at.BEND, k] = 0.0
    m.lists[at.AWAKE, m.counts[at.N_AWAKE]] = k
    m.counts[at.N_AWAKE] += 1
    return pop(m)


@kernel
def wake_for(p: Problem, m: Memory, dt: float) -> int:
    """Wake the nearest guard that may flip within `dt` at present rates, and return it.

    The result is -1 if there is none. Guards that turn out to be far away sleep on.
    """
    travel = m.clock[at.TRAVEL]
    bound = MARGIN * m.clock[at.SPEED] * dt
    k = -1
    while k < 0 and m.counts[at.N_ASLEEP] > 0 and not m.wake_at[0] > travel + bound:
        k = wake_first(p, m, travel + SLEEPS_FROM * bound)
    return k


@kernel
def wake(p: Problem, m: Memory, dt: float) -> None:
    """Wake all guards that may flip within the step, and evaluate them at its end."""
    if p.rate_bound == 0:
        return
    limit = m.clock[at.TRAVEL] + step_travel(p, m, dt)
    while m.counts[at.N_ASLEEP] > 0 and not m.wake_at[0] > limit:
        k = wake_first(p, m, limit)
        if k >= 0:
            m.counts[at.NGEV] += 1
            eval_guard(p, m, m.clock[at.T] + dt, at.END, at.KEND, k, at.H1, at.RATE1)


@kernel
def travel_on(p: Problem, m: Memory, dt: float) -> None:
    """Add the travel of the step from Y to END, and put distant guards to sleep."""
    if p.rate_bound == 0:
        return
    travel = step_travel(p, m, dt)
    m.clock[at.TRAVEL] += travel
    m.clock[at.SPEED] = speed_at(p, m, m.clock[at.T] + dt, at.END, at.KEND)
    kept = 0
    for a in range(m.counts[at.N_AWAKE]):
        k = m.lists[at.AWAKE, a]
        distance = abs(m.guards[at.H1, k])
        if distance > SLEEPS_FROM * travel:
            push(m, k, m.clock[at.TRAVEL] + distance)
        else:
            m.lists[at.AWAKE, kept] = k
            kept += 1
    m.counts[at.N_AWAKE] = kept


@kernel
def wake_all(m: Memory) -> None:
    """Wake all guards, because the state has jumped."""
    for node in range(m.counts[at.N_ASLEEP]):
        k = m.lists[at.HEAP, node]
        m.guards[at.SIZE, k] = 0.0
        m.guards[at.BEND, k] = 0.0
    m.counts[at.N_ASLEEP] = 0
    m.counts[at.N_AWAKE] = m.guards.width
    for k in range(m.guards.width):
        m.lists[at.AWAKE, k] = k


# Guards that are left out of the evaluations for ranges.

#: Way from a piece of a step to the end of the box around it, either way, at first.
#: Unit: pieces. Origin: chosen.
REACH = 32.0

#: Factor by which it becomes shorter where too few guards are left out, and longer
#: again after a box that has served for few pieces only.
#: Unit: 1. Origin: chosen.
SHORTER = 0.25
LONGER = 4.0

#: Least reach; where even such a box leaves out too few guards, the next is put off.
#: Unit: pieces. Origin: chosen.
LEAST_REACH = 0.5

#: Share of the guards that a box must leave out.
#: Unit: 1. Origin: chosen.
LEAST_SHARE = 0.5

#: Least distance from its surface, over its range within the box, of a guard that is
#: left out. It is at least `proof.NEARLY`: then the proof never asks for more of it.
#: Unit: 1. Origin: chosen.
LEAST_CLEARANCE = 1.0

#: Pieces for which a box must have served, or else the next one is put off.
#: Unit: 1. Origin: chosen.
FEW_USES = 3

#: Most pieces for which it is put off.
#: Unit: 1. Origin: chosen.
LONGEST_PAUSE = 64


@kernel
def put_off(m: Memory) -> None:
    """Make no box for some pieces, twice as many as the last time."""
    c = m.counts
    c[at.LEFT_PAUSE] = min(2 * c[at.LEFT_PAUSE] + 1, LONGEST_PAUSE)
    c[at.LEFT_WAIT] = c[at.LEFT_PAUSE]


@kernel
def waits(m: Memory) -> bool:
    """Return whether no box is made yet, because the last ones did not serve.

    A box that there is holds no longer: it is forgotten, and for how many pieces it has
    served decides about the next one.
    """
    c = m.counts
    if c[at.LEFT_OUT] > 0:
        c[at.LEFT_OUT] = 0
        if c[at.LEFT_USES] >= FEW_USES:
            c[at.LEFT_PAUSE] = 0
        elif m.clock[at.LEFT_REACH] < REACH:
            m.clock[at.LEFT_REACH] *= LONGER
        else:
            put_off(m)
    c[at.LEFT_USES] = 0
    if c[at.LEFT_WAIT] > 0:
        c[at.LEFT_WAIT] -= 1
        return True
    return False


@kernel_apart
def widen(p: Problem, m: Memory, start: float, end: float) -> float:
    """Write a box around the ranges of the states, and return until when it holds.

    The slopes stay as they are: no value of a guard that may be left out depends on
    them (see `numbers.choice`). The parameters for which the box holds are kept.
    """
    s = m.states
    reach = m.clock[at.LEFT_REACH]
    for i in range(s.width):
        way = reach * (s[at.MOST, i] - s[at.LEAST, i])
        s[at.BOX_LEAST, i] = s[at.LEAST, i] - way
        s[at.BOX_MOST, i] = s[at.MOST, i] + way
        s[at.BOX_LEAST_SLOPE, i] = s[at.LEAST_SLOPE, i]
        s[at.BOX_MOST_SLOPE, i] = s[at.MOST_SLOPE, i]
    m.clock[at.LEFT_FROM] = start
    m.clock[at.LEFT_TO] = end + reach * (end - start)
    first = 2 * (p.mode.width + p.params.width)
    for i in range(p.params.width):
        p.kept[first + i] = p.params[i]
    return m.clock[at.LEFT_TO]


@kernel_apart
def choose_ranged(p: Problem, m: Memory) -> None:
    """Leave out the guards whose ranges over the box are clear of zero by far.

    If these are too few, none is left out, and the next box is smaller or put off.
    """
    g = m.guards
    left_out = 0
    for k in range(g.width):
        low = g[at.RANGES, k]
        high = g[at.RANGES + 1, k]
        least = low if p.mode[k] > 0 else -high
        is_clear = least > LEAST_CLEARANCE * (high - low)
        m.flags[at.RANGED, k] = 0 if is_clear else 1
        left_out += 1 if is_clear else 0
    if left_out > LEAST_SHARE * g.width:
        m.counts[at.LEFT_OUT] = left_out
        return
    m.clock[at.LEFT_REACH] *= SHORTER
    if m.clock[at.LEFT_REACH] < LEAST_REACH:
        m.clock[at.LEFT_REACH] = REACH
        put_off(m)


@kernel_apart
def is_inside(p: Problem, m: Memory, start: float, end: float) -> bool:
    """Return whether what is known of guards that are left out holds for a piece.

    Its states and times must be in the box, the parameters must be the same, and each
    of these guards must still be on the side that its lock says: a handler may set it.
    """
    if m.counts[at.LEFT_OUT] == 0:
        return False
    if not (m.clock[at.LEFT_FROM] <= start and end <= m.clock[at.LEFT_TO]):
        return False
    s = m.states
    beyond = 0
    for i in range(s.width):
        inside = (s[at.BOX_LEAST, i] <= s[at.LEAST, i]) & (
            s[at.MOST, i] <= s[at.BOX_MOST, i]
        )
        beyond += 0 if inside else 1
    first = 2 * (p.mode.width + p.params.width)
    for i in range(p.params.width):
        beyond += 0 if p.kept[first + i] == p.params[i] else 1
    if beyond > 0:
        return False
    g = m.guards
    turned = 0
    for k in range(g.width):
        least = g[at.RANGES, k] if p.mode[k] > 0 else -g[at.RANGES + 1, k]
        turned += 0 if (m.flags[at.RANGED, k] != 0) | (least > 0.0) else 1
    return turned == 0
