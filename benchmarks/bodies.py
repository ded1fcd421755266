"""Bodies that land on two to six legs, with their true differences between contact orders.

A bench for the verdict. It shares no code with the scenes, the synthesis and the
integrator of hopdata: a rigid body on massless legs, integrated by RK4 in steps of 1 ms
with located contacts (`body_motion`). Only the coordinates in which a verdict measures
are hopdata's (`marker_states`, `marker_motions`, `contrasts`, `relative_size`).
`body_seen` makes of landings what a camera shows.

A body is drawn from its seed. Seeds 0 to 99 (`CHOOSE`) are for choosing how the verdict
works, seeds from 1000 on (`REPORT`) only for reporting how often it errs.

An input u of a landing holds 8 numbers of the body at the pre section (pitch, roll,
velocity, spin) and the displacements (X, Y, Z) of its n feet in the body, which are the
posture. The outcome holds 11 numbers at the post section (`hopdata.rigid.OUTPUT_NAMES`).
SI units, z up; angles are intrinsic ZYX.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import combinations, permutations

import numpy as np
from body_motion import GRAVITY, LEGS, MECHANISMS, Build, land_all

from hopdata.maps.truth.maps import marker_motions
from hopdata.maps.verdict.effect import contrasts, relative_size
from hopdata.maps.verdict.inputs import halves

CHOOSE = range(100)
REPORT = range(1000, 2000)

#: Mechanisms whose difference is a kink that fades within milliseconds.
SATURATING = ["friction", "stick", "sated", "decay"]
#: Mechanisms after which two orders lead to different states at the same contact.
JUMPING = ["rank", "latch", "impact"]
#: Mechanisms that need feet that move over the floor.
OF_SLIDING_FEET = ["friction", "stick"]

# The strength from which that of a wanted size is extrapolated, and the largest.
TRIAL_STRENGTH = 0.3
STRONGEST = {"impact": 0.4, "rank": 0.8, "latch": 1.0}
STRONGEST_OF_OTHERS = 4.0


@dataclass(frozen=True)
class Truth:
    """The exact differences between contact orders, as docs/verdict.md measures them.

    Attributes
    ----------
    kink
        Size of the difference of derivatives at the simultaneous contact.
    jump
        Size of the jump of the outcome there.
    averaged
        Size of the difference of derivatives that the mechanism makes, averaged over
        the landings of each order: less than `kink` if it saturates. NaN if not asked.
    """

    kink: float
    jump: float
    averaged: float = float("nan")


@dataclass(frozen=True)
class Landings:
    """Exact landings of a body.

    Attributes
    ----------
    inputs
        (N, 8 + 3 F) state and posture at the pre section.
    outcomes
        (N, 11) at the post section.
    instants
        (N, F) contact instants after the pre section, s.
    ends
        (N,) instants of the post section, s.
    wear
        (N, 2) factors of the legs' force and of friction.
    time, blocks
        (N,) place in the session from 0 to 1, and label of the surface.
    """

    inputs: np.ndarray
    outcomes: np.ndarray
    instants: np.ndarray
    ends: np.ndarray
    wear: np.ndarray
    time: np.ndarray
    blocks: np.ndarray

    def __len__(self) -> int:
        return len(self.inputs)

    def some(self, rows: np.ndarray | slice) -> "Landings":
        """Return the landings of these rows."""
        return Landings(*(column[rows] for column in vars(self).values()))


Session = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def steady(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return wear and surfaces of a session in which nothing changes."""
    return np.ones((len(time), 2)), np.zeros(len(time), int)


def softening(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Legs have lost 30 % of their force at the end."""
    wear, surface = steady(time)
    wear[:, 0] = 1.2 - 0.36 * time
    return wear, surface


def _on(surface: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    wear = np.where(surface[:, None] == 1, [0.8, 0.5], [1.2, 1.5])
    return wear, surface


def two_surfaces(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First a stiff and rough surface, then a soft and smooth one."""
    return _on((time >= 0.5).astype(int))


def by_turns(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the two surfaces, landing by landing in turn."""
    return _on(np.arange(len(time)) % 2)


SESSIONS: dict[str, Session] = {
    "steady": steady,
    "softening": softening,
    "two surfaces": two_surfaces,
    "by turns": by_turns,
}


@dataclass(frozen=True)
class Body:
    """A body drawn from a seed.

    Attributes
    ----------
    seed
        Seed of the body.
    mechanism
        One of `MECHANISMS`.
    feet
        Number of feet, two to six.
    spread_s
        Root mean square of the contact instants about their mean that tilt alone would
        give if no leg pushed, s. The first feet right the body, so it is less.
    scatter_m
        Standard deviation of each coordinate of each foot from landing to landing, m.
    leg
        One of `LEGS`; drawn from the seed if empty.
    strength
        Strength of the mechanism.
    """

    seed: int
    mechanism: str = "c1"
    feet: int = 3
    spread_s: float = 0.010
    scatter_m: float = 0.0
    leg: str = ""
    strength: float = 0.0
    build: Build = field(init=False, repr=False)
    base: np.ndarray = field(init=False, repr=False)
    markers: np.ndarray = field(init=False, repr=False)
    mean: np.ndarray = field(init=False, repr=False)
    sd: np.ndarray = field(init=False, repr=False)
    top_m: float = field(init=False)
    bottom_m: float = field(init=False)

    def __post_init__(self) -> None:
        """Draw the body."""
        n = self.feet
        rng = np.random.default_rng([self.seed, n, 55])
        leg = self.leg or self._leg()
        mass = rng.uniform(1.5, 4.0)
        speed = rng.uniform(1.4, 2.0)
        reach = rng.uniform(0.16, 0.26)
        length = rng.uniform(0.22, 0.32)
        inertia = mass * (reach * rng.uniform(0.55, 0.85, 3)) ** 2
        angle = 2 * np.pi * np.arange(n) / n + rng.uniform(0, 2 * np.pi)
        angle += rng.normal(0.0, 0.1, n)
        away = reach * rng.uniform(0.9, 1.1, n)
        across = np.column_stack([away * np.cos(angle), away * np.sin(angle)])
        base = np.column_stack([across, np.full(n, -length)])
        hips = np.column_stack([0.7 * across, np.zeros(n)])

        # The post section is as deep as the last contacts, the nadir much deeper.
        out = np.hypot(self.spread_s * speed, self.scatter_m)
        depth = max(0.025, 2.2 * out)
        travel = max(0.11, 1.8 * depth)
        load = mass * (speed**2 / 2 / travel + GRAVITY) / n
        uneven = rng.uniform(0.8, 1.2, (3, n))
        forward = rng.uniform(0.0, 0.8)

        ring = [[0.10, 0.02, 0.02], [-0.05, 0.09, 0.03], [-0.06, -0.08, 0.00]]
        markers = np.array(ring) + rng.normal(0.0, 0.01, (3, 3))
        centre = markers.mean(axis=0)
        build = Build(
            mass=mass,
            inertia=inertia,
            centre=centre,
            hips=hips,
            stiffness=load / travel * 1.1 * uneven[0],
            damping=load * 0.4 / speed * uneven[1],
            preload=load * 0.2 * uneven[2],
            friction=rng.uniform(0.3, 0.6),
            leg=LEGS.index(leg),
            mechanism=MECHANISMS.index(self.mechanism),
            strength=float(self.strength),
            load=load,
            reach=reach,
        )
        tilt = self.spread_s * speed / reach
        of_state = [tilt, tilt, 0.15, 0.15, 0.08, 0.35, 0.35, 0.3]
        level = length + centre[2]
        drawn = {
            "build": build,
            "base": base,
            "markers": markers - centre,
            "mean": np.array([0, 0, forward, 0, -speed, 0, 0, 0] + [0.0] * (3 * n)),
            "sd": np.array(of_state + [self.scatter_m] * (3 * n)),
            "top_m": level + max(0.008, 2.7 * out),
            "bottom_m": level - depth,
        }
        for name, value in drawn.items():
            object.__setattr__(self, name, value)

    @property
    def drawn_leg(self) -> str:
        """Return the kind of its legs."""
        return LEGS[self.build.leg]

    def _leg(self) -> str:
        able = list(LEGS)
        if self.mechanism in OF_SLIDING_FEET:
            able.remove("pivoting")
        return able[self.seed % len(able)]

    def landings(
        self, n: int, rng: np.random.Generator, session: Session = steady
    ) -> Landings:
        """Return n whole landings.

        Raises
        ------
        ValueError
            If fewer than a fifth of the body's landings are whole.
        """
        time = np.arange(n) / max(n - 1, 1)
        wear, blocks = session(time)
        us = np.zeros((n, len(self.sd)))
        ys = np.zeros((n, 11))
        instants = np.zeros((n, self.feet))
        ends = np.zeros(n)
        missing = np.arange(n)
        for _ in range(20):
            drawn = rng.standard_normal((len(missing), len(self.sd)))
            us[missing] = self.mean + self.sd * drawn
            found = self.land(us[missing], wear[missing])
            ys[missing], instants[missing], ends[missing], whole = found
            missing = missing[~whole]
            if not len(missing):
                return Landings(us, ys, instants, ends, wear, time, blocks)
        raise ValueError(f"{self}: few of its landings are whole")

    def land(
        self, us: np.ndarray, wear: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return outcomes (N, 11), instants (N, F), ends (N,), and which are whole."""
        if wear is None:
            wear = np.ones((len(us), 2))
        return land_all(us, wear, self.base, self.top_m, self.bottom_m, self.build)

    def derivatives(
        self, us: np.ndarray, wear: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return outcomes (N, 11) and their derivatives (N, 11, p) by differences.

        Derivatives with respect to inputs that do not vary in this body, other than the
        heights of its feet, are left out as zero.
        """
        n, p = us.shape
        if wear is None:
            wear = np.ones((n, 2))
        wanted = self.sd > 0.0
        wanted[10::3] = True  # heights of the feet
        varying = np.flatnonzero(wanted)
        count = len(varying)
        steps = np.full(p, 1e-6)
        steps[2:8] = 1e-5
        moves = np.diag(steps)[varying]
        moves = np.vstack([np.zeros(p), moves, -moves])
        around = (us[:, None] + moves).reshape(-1, p)
        ys = self.land(around, np.repeat(wear, len(moves), axis=0))[0]
        ys = ys.reshape(n, len(moves), 11)
        changes = ys[:, 1 : count + 1] - ys[:, count + 1 :]
        slopes = np.zeros((n, 11, p))
        slopes[:, :, varying] = np.swapaxes(changes / (2 * steps[varying, None]), 1, 2)
        return ys[:, 0], slopes

    def truth(self, landings: Landings, over: int = 0, most: int = 240) -> Truth:
        """Return the exact differences for these landings.

        `over` is the number of landings over which the size is averaged; none if 0.
        With more than three feet, the orders are those of the first `most` landings.
        """
        orders, counts = self._orders(landings, most)
        at = np.tile(self.mean, (len(orders), 1))
        for k, order in enumerate(orders):
            # Each foot 20 um above the one that touches before it.
            at[k, 8 + 2 + 3 * order] += 2e-5 * np.arange(self.feet)
        wear = np.tile(landings.wear.mean(axis=0), (len(orders), 1))
        values, slopes = self.derivatives(at, wear)
        values = values - np.einsum("kyp,kp->ky", slopes, at - self.mean)
        motions = marker_motions(self.markers)
        root = _root(np.cov(landings.inputs.T))
        moved = motions @ slopes @ root
        weights = contrasts(orders, counts)
        averaged = float("nan")
        if over:
            averaged = self._averaged(landings.some(slice(over)), moved, root)
        return Truth(
            kink=relative_size(moved, weights),
            jump=_jump(orders, values @ motions.T, moved.mean(axis=0)),
            averaged=averaged,
        )

    def _orders(self, landings: Landings, most: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the orders (S, F) that are compared, and how often they occur (S,).

        With up to three feet all orders count alike; with more, those of the first
        `most` landings.
        """
        if self.feet <= 3:
            orders = np.array(list(permutations(range(self.feet))))
            return orders, np.full(len(orders), 100)
        seen = np.argsort(landings.instants[:most], axis=1)
        orders, counts = np.unique(seen, axis=0, return_counts=True)
        return orders, counts * len(landings) // min(most, len(landings))

    def _averaged(
        self, landings: Landings, moved: np.ndarray, root: np.ndarray
    ) -> float:
        """Return the size of the difference that the mechanism makes, over landings."""
        plain = replace(self, mechanism="c1", strength=0.0, leg=self.drawn_leg)
        _, own = self.derivatives(landings.inputs, landings.wear)
        _, without = plain.derivatives(landings.inputs, landings.wear)
        changes = marker_motions(self.markers) @ (own - without) @ root
        seen = np.argsort(landings.instants, axis=1)
        orders, which, counts = np.unique(
            seen, axis=0, return_inverse=True, return_counts=True
        )
        which = which.ravel()
        of_orders = [changes[which == k].mean(axis=0) for k in range(len(orders))]
        common = moved.mean(axis=0)
        maps = np.array(of_orders)
        # The differences of the changes, relative to the map at the simultaneous contact.
        maps = maps - np.tensordot(contrasts(orders, counts)[1], maps, axes=1) + common
        return relative_size(maps, contrasts(orders, counts))


def _root(covariance: np.ndarray) -> np.ndarray:
    squares, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(squares.clip(0.0))


def _jump(orders: np.ndarray, values: np.ndarray, mean: np.ndarray) -> float:
    """Return the size of the jumps of the outcome `values` (S, 11) between orders."""
    place = np.argsort(orders, axis=1)
    pairs = list(combinations(range(orders.shape[1]), 2))
    signs = [np.sign(place[:, i] - place[:, j]) for i, j in pairs]
    design = np.column_stack([np.ones(len(orders)), *signs])
    # From -1 to 1 the outcome changes by twice the coefficient.
    jumps = 2.0 * np.linalg.lstsq(design, values, rcond=None)[0][1:]
    variance = np.sum(mean**2, axis=1)
    return float(np.sqrt(np.mean(jumps**2 @ halves(variance))))


def body_of_size(size: float, landings: int = 400, **drawn) -> Body:
    """Return a body whose mechanism makes a difference of about this size.

    The difference is the jump of mechanisms that jump, the average over landings of
    those that saturate, and that of the derivatives at the simultaneous contact of the
    others. The mechanism is not made stronger than `STRONGEST`; its exact size is that
    of `Body.truth`.
    """
    trial = Body(strength=TRIAL_STRENGTH, **drawn)
    if trial.mechanism == "c1":
        return replace(trial, strength=0.0)
    strongest = STRONGEST.get(trial.mechanism, STRONGEST_OF_OTHERS)
    over = 0
    if trial.mechanism in SATURATING:
        over = 30
    body = trial
    for _ in range(2):
        rng = np.random.default_rng([body.seed, 56])
        drawn_landings = body.landings(landings, rng)
        made = leading(body.mechanism, body.truth(drawn_landings, over, most=60))
        strength = body.strength * size / max(made, 1e-6)
        body = replace(body, strength=min(strongest, strength))
    return body


def leading(mechanism: str, truth: Truth) -> float:
    """Return the size by which a mechanism differs most."""
    if mechanism in JUMPING:
        return truth.jump
    if mechanism in SATURATING:
        return truth.averaged
    return truth.kink
