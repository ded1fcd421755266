"""Guards that cannot flip for a while sleep, so that a step spends nothing on them.

No event function changes faster than the scene's rate bound. A guard can therefore
sleep until the travel, the integral of the bound over time, has used up its distance
from the surface. The sleeping guards form a heap, ordered by the travel at which they
must wake.
"""

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import call_rate_bound, kernel
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
REST = 4.0


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
        k = wake_first(p, m, travel + REST * bound)
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
        if distance > REST * travel:
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
