"""Saltation matrices: what a guard's crossing does to a small deviation."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import factorial

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.first_order import linearise as local
from hopdata.hybrid.first_order.crossings import (
    NoDerivativeError,
    after_crossing,
    after_law,
    approached,
    handled,
    settled,
)
from hopdata.hybrid.first_order.linearise import Instant, Linearisation
from hopdata.hybrid.system import System


class NotTransversalError(ValueError):
    """A guard is not crossed transversally: it has no rate along the field."""


def saltation_matrix(
    before: ArrayLike,
    after: ArrayLike,
    gradient: ArrayLike,
    *,
    time_rate: float = 0.0,
    reset: ArrayLike | None = None,
    reset_rate: ArrayLike | None = None,
) -> FloatArray:
    """Return the saltation matrix of one crossing (Aizerman and Gantmacher 1958).

    With the reset r and the event function h, the matrix is
    Dr + (f+ - Dr f- - dr/dt) Dh / (Dh f- + dh/dt).

    Parameters
    ----------
    before, after : (n,) array_like
        Field f- before and f+ after the crossing; f+ is taken at the state after the
        reset.
    gradient : (n,) array_like
        Derivative Dh of the event function with respect to the state.
    time_rate : float
        Derivative of the event function with respect to time.
    reset, reset_rate : (n, n) and (n,) array_like, optional
        Derivatives of the reset with respect to state and time. By default there is no
        reset.

    Returns
    -------
    (n, n) array

    Raises
    ------
    NotTransversalError
        If the event function does not change along f-.
    """
    f = np.asarray(before, dtype=np.float64)
    g = np.asarray(after, dtype=np.float64)
    slope = np.asarray(gradient, dtype=np.float64)
    rate = _rate(f, slope, time_rate)
    if reset is None:
        reset = np.eye(len(f))
    if reset_rate is None:
        reset_rate = 0.0
    kept = np.asarray(reset, dtype=np.float64)
    moved = kept @ f + np.asarray(reset_rate, dtype=np.float64)
    return kept + np.outer(g - moved, slope) / rate


def _rate(f: FloatArray, slope: FloatArray, time_rate: float) -> float:
    """Return the rate of an event function along a field; raise if there is none."""
    rate = float(slope @ f) + time_rate
    if rate == 0 or not np.isfinite(rate):
        raise NotTransversalError(
            f"expected a rate of the guard other than 0, found {rate}"
        )
    return rate


def with_lock(mode: IntArray, guard: int, lock: int) -> IntArray:
    """Return a mode with another lock."""
    changed = mode.copy()
    changed[guard] = lock
    return changed


#: Displacement of the state at which a handler is tried, to see whether it changes the
#: state beside the one that is checked.
#: Unit: 1, of a coordinate's size. Origin: chosen.
BESIDE = 1e-7


def crossing(
    system: System, here: Linearisation, guard: int, scale: FloatArray
) -> tuple[FloatArray, Linearisation]:
    """Return the saltation matrix of a crossing, and the linearisation after it.

    The handler's derivative belongs to it if it changes this state or a neighbouring
    one.
    """
    at = here.instant
    if system.sliding:
        entered, reached, told = after_crossing(system, at, guard, scale)
        there = settled(system, reached, scale).here
    else:
        told = -int(at.mode[guard])
        entered = replace(at, mode=with_lock(at.mode, guard, told))
        there = local.linearise(system, local.cross(system, at, guard), scale)

    def after(p: Instant) -> FloatArray:
        return handled(system, replace(entered, y=p.y, t=p.t), guard, told).y

    # Each coordinate by another share, so that no sum of them stays as it is.
    shares = np.sqrt(1.0 + np.arange(len(scale)))
    beside = at.moved(at.y + BESIDE * scale * shares, at.t)
    reset = None
    reset_rate = None
    if any((after(p) != p.y).any() for p in (at, beside)):
        exact = system.exact.handler(at.t, at.y, entered.mode, at.params, guard, told)
        if exact is None:
            exact = local.differentiate(after, at, scale)
        reset, reset_rate = exact
    matrix = saltation_matrix(
        here.rate,
        there.rate,
        here.gradients[guard],
        time_rate=float(here.time_rates[guard]),
        reset=reset,
        reset_rate=reset_rate,
    )
    return matrix, there


# The orders in which guards that meet at one state may be crossed, each with its
# matrix.

#: A cone of deviations that is thinner counts as a plane: its order does not occur.
#: Unit: 1. Origin: chosen.
NARROW = 1e-9
#: Most orders of crossing that are all tried; with more, as many random deviations.
#: Unit: 1. Origin: derived: 6!, all orders of six guards.
MOST_ORDERS = 720


#: Most crossings of each guard within one instant, of neighbours that meet it again.
#: Unit: 1. Origin: chosen.
MOST_AGAIN = 16

#: Largest distance between the ends of neighbours that counts as none.
#: Unit: 1, of a coordinate's size. Origin: chosen.
SAME_END = 1e-9


@dataclass(frozen=True)
class Node:
    """The trajectory after some of the crossings.

    `product` (n, n) maps a deviation before the first crossing to the deviation from
    the nominal trajectory of the mode reached.
    """

    here: Linearisation
    product: FloatArray

    @property
    def delays(self) -> FloatArray:
        """Functionals that map a deviation to the times of crossing, (n_guards, n)."""
        changes = self.here.gradients @ self.product
        with np.errstate(divide="ignore", invalid="ignore"):
            return -changes / self.here.guard_rates[:, None]


@dataclass(frozen=True)
class CrossingOrder:
    """One order in which the guards may be crossed.

    Parameters
    ----------
    guards : tuple of int
        Indices of the guards, the first crossed first. One that rebounds stands there
        twice: as it is entered and as it is left; one that is hit again, more often.
    matrix : (n, n) array
        Product of the saltation matrices.
    direction : (n,) array
        Unit deviation whose trajectory crosses in this order and stays well clear of
        other orders.
    state : (n,) array
        State after the crossings; it depends on the order only if handlers change the
        state.
    """

    guards: tuple[int, ...]
    matrix: FloatArray
    direction: FloatArray
    state: FloatArray


def _delays_of(node: Node, deviation: FloatArray) -> FloatArray:
    """Return when a neighbour meets each guard, s; infinity where a guard rests."""
    with np.errstate(invalid="ignore"):  # infinite slopes of a guard at rest
        delays = node.delays @ deviation
    return np.where(np.isfinite(delays), delays, np.inf)


class BouligandDerivative:
    """The crossings of some guards in any order from a state, computed on demand.

    It is called with deviations v from that state, (n,) or (n, m), at the instant at
    which the nominal trajectory meets the guards. It returns D_v, of the same shape:
    the position of the neighbour relative to the nominal trajectory once both have
    crossed all guards, carried back to that instant by the last field. D_v is linear on
    each cone of deviations whose trajectories cross the guards in one order, and
    continuous across cones (Burden, Sastry, Koditschek and Revzen 2016; dissertation,
    section 1.2).
    """

    def __init__(
        self, system: System, start: Instant, guards: Sequence[int], scale: FloatArray
    ) -> None:
        self.system = system
        self.guards = tuple(guards)
        self.scale = scale
        # Whether neighbours have to end beside the trajectory, in its mode.
        self._ends_at_one = bool(system.sliding) or system.together is not None
        self._end: Instant | None = None
        if system.together is not None:
            self._end = after_law(system, start, self.guards, scale)
        if system.sliding:
            mix = settled(system, start, scale)
            root = Node(mix.here, mix.projection)
        else:
            root = Node(local.linearise(system, start, scale), np.eye(system.n_states))
        self._nodes: dict[tuple[int, ...], Node] = {(): root}
        self._sizes = root.here.guard_scales

    def __repr__(self) -> str:
        n = self.system.n_states
        names = ", ".join(self.system.guard_names[k] for k in self.guards)
        return (
            f"BouligandDerivative where the guards {names} are met: call it with "
            f"deviations ({n},) or ({n}, m); order(deviation) tells in which order "
            "they are crossed"
        )

    def __call__(self, deviations: ArrayLike) -> FloatArray:
        """Return the directional derivatives D_v."""
        v = np.asarray(deviations, dtype=np.float64)
        n = self.system.n_states
        fits = v.ndim in (1, 2) and len(v) == n
        expect(fits, "deviations", f"({n},) or ({n}, m)", v.shape)
        if v.ndim == 1:
            order = self.order(v)
            if not self._ends_at_one:
                self._check_resets(order)
            return self.node(order).product @ v
        return np.array([self(column) for column in v.T]).reshape(v.T.shape).T

    def node(self, order: tuple[int, ...]) -> Node:
        """Return the node after the crossings in this order.

        Raises
        ------
        NotTransversalError
            If a guard is not approached.
        """
        if order not in self._nodes:
            guard = order[-1]
            before = self.node(order[:-1])
            rate = before.here.guard_rates[guard]
            mode = before.here.instant.mode
            if not -mode[guard] * rate > 0:  # not approached from its lock's side
                raise self._not_approached(before.here, guard)
            matrix, here = crossing(self.system, before.here, guard, self.scale)
            self._nodes[order] = Node(here, matrix @ before.product)
        return self._nodes[order]

    def _not_approached(self, here: Linearisation, guard: int) -> NotTransversalError:
        """Return the error of a guard that is to be met, and is not approached."""
        name = self.system.guard_names[guard]
        mode = here.instant.mode
        return NotTransversalError(
            f"guard {name}: expected to be approached, found a rate of "
            f"{here.guard_rates[guard]:.3g} on the side {mode[guard]:+d} in mode "
            f"{mode.tolist()}"
        )

    def order(self, deviation: ArrayLike) -> tuple[int, ...]:
        """Return the order in which the neighbour at a deviation (n,) crosses guards.

        The order is exact to first order: the neighbour follows one constant field
        after another. Guards crossed simultaneously keep the order in which they are
        named. A guard is crossed again where it is approached again at this instant:
        where it rebounds, or is hit again because another one has rebounded.
        """
        v = np.asarray(deviation, dtype=np.float64)
        order = self._followed(v, self.guards)
        if self._ends_at_one:
            self._check_end(order, self.node(order).here.instant)
        return order

    def _followed(
        self, deviation: FloatArray, guards: tuple[int, ...]
    ) -> tuple[int, ...]:
        """Return the order of a neighbour; at one time, the order is that of guards."""
        order: tuple[int, ...] = ()
        waiting = self._waiting(order, guards)
        while waiting:
            delays = _delays_of(self.node(order), deviation)
            order = (*order, min(waiting, key=lambda guard: delays[guard]))
            waiting = self._waiting(order, guards)
        return order

    def _waiting(self, order: tuple[int, ...], guards: tuple[int, ...]) -> list[int]:
        """Return the guards that neighbours are to meet after those of an order."""
        here = self.node(order).here
        waiting = approached(here, guards, self._sizes)
        if waiting and len(order) >= MOST_AGAIN * len(guards):
            names = [self.system.guard_names[k] for k in guards]
            raise NoDerivativeError(
                f"guards {names}: a neighbour meets them again and again, and so "
                f"does not come to an end of the instant by {len(order)} crossings"
            )
        missing = [guard for guard in guards if guard not in order]
        if missing and not waiting and not self._ends_at_one:
            raise self._not_approached(here, missing[0])
        return waiting

    def _check_resets(self, order: tuple[int, ...]) -> None:
        """Raise if a neighbour's resets end at another state than the trajectory's.

        Its own order is that of the numbers. Where that one is not crossed to its end,
        neighbours are compared with each other.
        """
        is_met_again = len(order) > len(self.guards)
        if self.system.on_event is None and not is_met_again:
            return
        if self._end is None:
            nowhere = np.zeros(self.system.n_states)
            try:
                own = self._followed(nowhere, tuple(sorted(self.guards)))
            except NotTransversalError:
                own = order
            self._end = self.node(own).here.instant
        found = self.node(order).here.instant
        self._check_state(order, found, self._end)
        guards = list(self.guards)
        if (found.mode[guards] != self._end.mode[guards]).any():
            raise self._parted(order, found, self._end)

    def _check_state(
        self, order: tuple[int, ...], found: Instant, end: Instant
    ) -> None:
        """Raise if neighbours that cross in an order do not end at a state."""
        names = [self.system.guard_names[k] for k in order]
        off = np.abs(found.y - end.y) / np.maximum(self.scale, np.abs(end.y))
        if (off > SAME_END).any():
            raise NoDerivativeError(
                f"neighbours that meet {names} in this order end at "
                f"{found.y.tolist()}, others, or the trajectory itself, at "
                f"{end.y.tolist()}: the flow jumps, and has no derivative"
            )

    def _check_end(self, order: tuple[int, ...], found: Instant) -> None:
        """Raise if the neighbours do not all end beside the trajectory."""
        if self._end is None:
            self._end = found
        end = self._end
        self._check_state(order, found, end)
        ends_so = self.system.together is not None or (found.mode == end.mode).all()
        if not ends_so:
            raise self._parted(order, found, end)

    def _parted(
        self, order: tuple[int, ...], found: Instant, end: Instant
    ) -> NoDerivativeError:
        """Return the error of neighbours that end in another mode."""
        names = [self.system.guard_names[k] for k in order]
        return NoDerivativeError(
            f"neighbours that meet {names} in this order end in mode "
            f"{found.mode.tolist()}, others in {end.mode.tolist()}: trajectories "
            "part there, and the flow has no derivative"
        )

    def pieces(self, *, seed: int = 0) -> tuple[CrossingOrder, ...]:
        """Return the orders that occur among the deviations, with their matrices.

        An order occurs if the deviations that cross in it have an interior. With up to
        six guards all orders are tried; with more, those in which 720 random deviations
        cross.
        """
        inside: dict[tuple[int, ...], FloatArray] = {}
        if not self._ends_at_one and factorial(len(self.guards)) <= MOST_ORDERS:
            inside.update(self._cones((), np.zeros((0, len(self.scale))), self.scale))
        else:
            rng = np.random.default_rng(seed)
            draws = rng.normal(size=(MOST_ORDERS, self.system.n_states))
            for v in draws * self.scale:
                inside[self.order(v)] = v
        found = []
        for order, deviation in inside.items():
            last = self.node(order)
            direction = deviation / np.linalg.norm(deviation)
            state = last.here.instant.y
            found.append(CrossingOrder(order, last.product, direction, state))
        return tuple(found)

    def _cones(
        self, order: tuple[int, ...], rows: FloatArray, deviation: FloatArray
    ) -> Iterator[tuple[tuple[int, ...], FloatArray]]:
        """Yield orders that begin with this one, each with a deviation clear of others.

        Parameters
        ----------
        order : tuple of int
            What has been crossed.
        rows : (r, n) array
            Functionals that are positive where neighbours begin so, in units of the
            coordinates' sizes.
        deviation : (n,) array
            A deviation at which they are.
        """
        waiting = self._waiting(order, self.guards)
        if not waiting:
            yield order, deviation
        for guard in waiting:
            others = [other for other in waiting if other != guard]
            delays = self.node(order).delays * self.scale
            longest = float(np.abs(delays[waiting]).max())
            later = _well_above(delays[others] - delays[guard], longest)
            both = np.vstack([rows, later])
            found = _inside_cone(both)
            if found is not None:
                yield from self._cones((*order, guard), both, found * self.scale)


def _well_above(rows: FloatArray, size: float) -> FloatArray:
    """Return the rows that are not negligible beside a size, with the length 1.

    Negligible ones belong to guards that share a surface, which all deviations cross
    together.
    """
    lengths = np.linalg.norm(rows, axis=1)
    asking = lengths > NARROW * size
    return np.asarray(rows[asking] / lengths[asking, None])


def _inside_cone(rows: FloatArray) -> FloatArray | None:
    """Return v with rows @ v > 0, of rows of the length 1, or None if there is none.

    Then the rows sum to zero with weights >= 0 (Gordan 1873).
    The minimum of |rows.T w|^2 + (1 - sum w)^2 over w >= 0 is positive in the first
    case, and its minimiser gives v = rows.T w.
    """
    if len(rows) == 0:
        return np.ones(rows.shape[1])
    from scipy.optimize import nnls

    sums = np.vstack([rows.T, np.ones(len(rows))])
    weights, _ = nnls(sums, np.append(np.zeros(rows.shape[1]), 1.0))
    inside = rows.T @ weights
    if np.linalg.norm(inside) > NARROW:
        return np.asarray(inside)
    return None


def bouligand_derivative(
    system: System,
    state: ArrayLike,
    *,
    params: ArrayLike = (),
    mode: Sequence[int],
    t: float = 0.0,
    guards: Sequence[int | str] | None = None,
    scale: ArrayLike | None = None,
) -> BouligandDerivative:
    """Return the Bouligand derivative of the flow at a state on several surfaces.

    Parameters
    ----------
    system : System
        Field, guards and handler.
    state : (n,) array_like
        State at which the guards meet.
    params, mode, t
        As for `solve`; `mode` is the mode before the crossings, with all locks set: 0
        where the trajectory slides already.
    guards : sequence of int or str, optional
        Guards that are crossed; by default those on whose surface the state lies.
    scale : (n,) array_like, optional
        Size of each coordinate, which scales difference steps. By default 1.

    Returns
    -------
    BouligandDerivative
        Raises `NotTransversalError` when it reaches an order in which a guard is not
        approached. It raises `NoDerivativeError` where there is none: handlers of
        neighbours that meet the guards in another order end at another state, as after
        a plastic impact of several feet; where neighbours part, or meet the guards
        without an end (at most 16 times each); and, with a law for several guards at
        once (`System(together=...)`), where they end at another state than it gives,
        for they meet the guards one after the other, and the handlers decide about
        them.

    Raises
    ------
    ValueError
        If an argument does not fit the system.
    NoDerivativeError
        If the trajectory slides where its field is not unique.
    """
    both = system.together is None or not system.sliding
    expect(both, "system", "sliding= or together=, not both", "both")
    sizes = local.state_scale(system, scale)
    start = local.instant(
        system, state, params=params, mode=mode, t=t, sliding=system.sliding
    )
    closed = start.mode.copy()
    locks = closed[: system.n_guards]
    locks[locks == 0] = -1  # guards have the same values with any lock
    here = local.linearise(system, replace(start, mode=closed), sizes)
    chosen = local.active_guards(system, here, guards, sizes)
    return BouligandDerivative(system, start, chosen, sizes)


# Derivative of the state at which trajectories meet a section, from the derivative of
# the flow.


def project_onto_section(
    flow: ArrayLike, rate: ArrayLike, gradient: ArrayLike, *, time_rate: float = 0.0
) -> FloatArray:
    """Return the derivative of the impact state, (I - f Dh / (Dh f + dh/dt)) Phi.

    The flow's derivative locates a neighbour at the same time; this one locates it
    where it meets the surface h = 0. The two differ by the remaining time, multiplied
    by the rate f.

    Parameters
    ----------
    flow : (n, k) array_like
        Derivative Phi of the state at the instant of the event, before its handler.
    rate : (n,) array_like
        Field f at that state.
    gradient : (n,) array_like
        Derivative Dh of the event function with respect to the state.
    time_rate : float
        Derivative of the event function with respect to time.

    Returns
    -------
    (n, k) array

    Raises
    ------
    NotTransversalError
        If the event function does not change along f.
    """
    phi = np.asarray(flow, dtype=np.float64)
    f = np.asarray(rate, dtype=np.float64)
    slope = np.asarray(gradient, dtype=np.float64)
    return phi - np.outer(f, slope @ phi) / _rate(f, slope, time_rate)
