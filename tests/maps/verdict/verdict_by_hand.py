"""The numbers of a verdict, computed by the steps of docs/verdict_method.md.

Only NumPy and SciPy are used. Numbers in docstrings are those of the steps there and on
the pages beside it (verdict_fit.md, verdict_answer.md).
"""

from dataclasses import dataclass, replace
from itertools import combinations, combinations_with_replacement
from math import ceil, comb
from zlib import crc32

import numpy as np
from scipy.special import ndtr, ndtri, owens_t
from scipy.stats import qmc

SHARES = (0.85, 0.925, 1.0)
VARIANCES = np.array([0.0, *(4.0 ** np.arange(-5, 9))])
TAUS = (1.0, 0.5, 0.25)


@dataclass(frozen=True)
class Study:
    """The input of the page, and its options."""

    x: np.ndarray
    y: np.ndarray
    instants: np.ndarray
    seed: int
    instants_se: np.ndarray | None = None
    feet: np.ndarray | None = None
    feet_se: np.ndarray | None = None
    time: np.ndarray | None = None
    blocks: np.ndarray | None = None
    margin: float = 0.2
    confidence: float = 0.95
    power: float = 0.8
    flips: int = 1999

    @property
    def level(self):
        """Return one minus the confidence."""
        return round(1 - self.confidence, 12)


@dataclass(frozen=True)
class Section:
    """Landings in coordinates without units, after steps 2 to 5."""

    inputs: np.ndarray
    states: np.ndarray
    n_bent: int
    outcomes: np.ndarray
    t: np.ndarray
    missed: np.ndarray
    foretold: float
    noise: np.ndarray
    unforetold: np.ndarray
    rest: np.ndarray
    bent: float
    time: np.ndarray
    blocks: np.ndarray
    kept: np.ndarray

    @property
    def n(self):
        """Return the number of landings that are left."""
        return len(self.t)

    @property
    def with_feet(self):
        """Return whether feet are inputs."""
        return self.inputs.shape[1] > 8


# Notation


def regular(covariance):
    """Notation: a covariance that can be inverted."""
    return covariance + 1e-9 * np.trace(covariance) * np.eye(len(covariance))


def root(covariance):
    """Notation: symmetric root."""
    values, vectors = np.linalg.eigh(covariance)
    kept = np.where(values > 1e-9**1.5 * values.max(), values, 0.0)
    return (vectors * np.sqrt(kept)) @ vectors.T


def whitened(columns):
    """Notation: columns of mean square one that span those given, less their means."""
    left, values, _ = np.linalg.svd(columns - columns.mean(axis=0), full_matrices=False)
    return np.sqrt(len(columns)) * left[:, values > 1e-9 * values[0]]


def basis(columns):
    """Notation: orthonormal basis of columns."""
    lengths = np.linalg.norm(columns, axis=0)
    unit = columns / np.where(lengths > 0, lengths, 1.0)
    left, values, _ = np.linalg.svd(unit, full_matrices=False)
    return left[:, values > 1e-9 * values[0]]


def beside(columns, orthonormal):
    """Notation: residuals on an orthonormal basis, taken twice against rounding."""
    once = columns - orthonormal @ (orthonormal.T @ columns)
    return once - orthonormal @ (orthonormal.T @ once)


def slopes(outcomes, columns):
    """Return slopes of LS of outcomes on columns and a constant."""
    centred = columns - columns.mean(axis=0)
    return np.linalg.lstsq(centred, outcomes - outcomes.mean(axis=0), rcond=None)[0]


def left_out(outcomes, design):
    """Notation: left-out errors."""
    q = basis(design)
    slack = np.maximum(1 - np.sum(q**2, axis=1), 0.001)
    return (outcomes - q @ (q.T @ outcomes)) / slack[:, None]


def factors(n_columns, degree):
    """Return the factors of each monomial."""
    return list(combinations_with_replacement(range(n_columns), degree))


def monomials(columns, degree):
    """Notation: all products of `degree` columns."""
    products = [columns[:, f].prod(axis=1) for f in factors(columns.shape[1], degree)]
    return np.column_stack(products)


def halves(squares):
    """Notation: weights of outcomes."""
    positions = np.full(5, 0.5 / squares[:5].sum())
    velocities = np.full(6, 0.5 / squares[5:].sum())
    return np.concatenate([positions, velocities])


# 1. Rows


def too_far(distance):
    """1a: whether each distance is gross among all."""
    n = len(distance)
    middle = np.median(distance)
    if middle == 0:
        return np.zeros(n, dtype=bool)
    upper = np.quantile(distance, 0.8)
    widths = ndtri(1 - 1 / (2 * n)) / ndtri(0.8)
    return distance > 1.5 * middle * np.exp(widths * np.log(upper / middle))


def markers(states):
    """Return positions and velocities, each (n, B, 3)."""
    positions, velocities = np.split(states, 2, axis=1)
    shape = (len(states), -1, 3)
    return positions.reshape(shape), velocities.reshape(shape)


def markers_apart(states):
    """1a: rows whose markers move against each other."""
    positions, velocities = markers(states)
    pairs = list(combinations(range(positions.shape[1]), 2))
    changes = []
    scales = []
    for a, b in pairs:
        r = positions[:, a] - positions[:, b]
        v = velocities[:, a] - velocities[:, b]
        length = np.linalg.norm(r, axis=1)
        middle = np.median(length)
        changes.append([length - middle, np.sum(r * v, axis=1) / middle])
        scales.append([np.full(len(r), middle), np.linalg.norm(v, axis=1)])
    lengths, speeds = np.linalg.norm(changes, axis=0)
    of_lengths, of_speeds = np.median(np.linalg.norm(scales, axis=0), axis=1)
    longer = too_far(lengths) & (lengths > 1e-9 * of_lengths)
    return longer | too_far(speeds) & (speeds > 1e-9 * of_speeds)


def rough_map_columns(section):
    """1c: columns of the rough map, and the number of steps, which are the last."""
    n = section.n
    scaled = section.inputs / section.inputs.std(axis=0)
    feet = section.t.shape[1]
    pairs = list(combinations(range(feet), 2))
    ways = whitened(section.t)[:, :2]
    before = [np.ones((n, 1)), scaled]
    s = section.time[:, None]
    if s.any():
        before += [s, s**2]
    levels = block_columns(section.blocks)
    if levels is not None:
        before.append(levels)
    before += [sharp_kinks(section.t), monomials(ways, 3)]
    steps = step_columns(section.t, section.unforetold, pairs)
    squares = monomials(scaled[:, : section.n_bent], 2)
    width = sum(c.shape[1] for c in [*before, squares, steps])
    if n < 2.5 * width:
        squares = monomials(scaled[:, :8], 2)
    return np.hstack([*before, squares, steps]), len(pairs)


def weighted_fit(design, outcomes, weights):
    """1c: coefficients and leverages of weighted LS."""
    by = np.sqrt(weights)[:, None]
    left, values, right = np.linalg.svd(design * by, full_matrices=False)
    kept = values > 1e-9 * values[0]
    left = left[:, kept]
    coefficients = right[kept].T @ ((left.T @ (outcomes * by)) / values[kept, None])
    return coefficients, np.sum(left**2, axis=1)


def lengths_by(inverse, rows):
    """Return (r' C^-1 r)^1/2 of each row."""
    return np.sqrt(np.einsum("ni,ij,nj->n", rows, inverse, rows))


def inverse_of(covariance):
    """1c: inverse with eigenvalues of at least 1e-9 of the largest."""
    values, vectors = np.linalg.eigh(covariance)
    return (vectors / np.maximum(values, 1e-9 * values[-1])) @ vectors.T


def distances_from_rough_map(section, rows):
    """1c: distances of the outcomes of these rows from a rough map of them."""
    columns, n_steps = rough_map_columns(section)
    columns = columns[rows]
    lengths = np.linalg.norm(columns, axis=0)
    lengths[lengths == 0] = 1.0
    unit = columns / lengths
    outcomes = section.outcomes[rows]
    outcomes = outcomes / outcomes.std(axis=0)
    weights = np.ones(len(rows))
    for _ in range(10):
        coefficients, leverages = weighted_fit(unit, outcomes, weights)
        misses = outcomes - unit @ coefficients
        misses = misses / np.sqrt(np.maximum(1 - leverages, 0.05))[:, None]
        inverse = inverse_of((misses * weights[:, None] ** 2).T @ misses)
        distances = [lengths_by(inverse, misses)]
        for k in range(columns.shape[1] - n_steps, columns.shape[1]):
            step = coefficients[k] / lengths[k]
            for side in (1, -1):
                moved = misses - np.outer(side - columns[:, k], step)
                distances.append(lengths_by(inverse, moved))
        least = np.min(distances, axis=0)
        middle = np.median(least)
        weights = middle / np.maximum(least, middle)
    return least


def mistakes(section):
    """1b: rows that are out."""
    states = section.states
    apart = np.abs(states - np.median(states, axis=0))
    far = np.any(apart > 16 * np.quantile(apart, 0.8, axis=0), axis=1)
    late = np.linalg.norm(section.missed, axis=1)
    contacts = too_far(late) & (late > 0.1)
    out = far | contacts
    rows = np.flatnonzero(~far)
    outcome = np.zeros(len(far), dtype=bool)
    outcome[rows] = too_far(distances_from_rough_map(section, rows))
    orders = np.argsort(section.t, axis=1, kind="stable")
    for order in np.unique(orders, axis=0):
        of_order = np.all(orders == order, axis=1)
        if of_order.sum() >= 20 and outcome[of_order].mean() > 0.25:
            outcome[of_order] = False
    return out | outcome


def known(study):
    """1: rows without missing elements; errors of instants and feet are known."""
    n = len(study.x)
    finite = np.isfinite(np.hstack([study.x, study.y, study.instants])).all(axis=1)
    se = np.zeros_like(study.instants)
    if study.instants_se is not None:
        se = np.nan_to_num(study.instants_se, nan=0.0)
    feet_se = None
    if study.feet is not None:
        feet_se = np.zeros_like(study.feet)
        if study.feet_se is not None:
            feet_se = np.nan_to_num(study.feet_se, nan=0.0)
    time = np.arange(n, dtype=float) if study.time is None else study.time
    blocks = np.zeros(n, dtype=int) if study.blocks is None else study.blocks
    full = replace(study, instants_se=se, feet_se=feet_se, time=time, blocks=blocks)
    return rows_of(full, finite)


def rows_of(study, rows):
    """Return a study of these rows."""
    names = ("x", "y", "instants", "instants_se", "feet", "feet_se", "time", "blocks")
    values = {name: getattr(study, name) for name in names}
    kept = {name: v[rows] for name, v in values.items() if v is not None}
    return replace(study, **kept)


def searched(study):
    """1: landings in coordinates without units, without mistakes."""
    study = rows_of(study, ~(markers_apart(study.x) | markers_apart(study.y)))
    section = in_section(study)
    for _ in range(5):
        out = np.zeros(len(section.kept), dtype=bool)
        out[section.kept] = mistakes(section)
        if not out.any():
            break
        study = rows_of(study, ~out)
        section = in_section(study)
    return section


# 2. Coordinates without units


def best_rotations(arms, shape):
    """2: proper rotations that bring the shape to the centred markers."""
    left, _, right = np.linalg.svd(np.einsum("nbi,bj->nij", arms, shape))
    left[..., 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    return left @ right


def aligned_shape(arms):
    """2: shape of the body by generalised Procrustes analysis."""
    shape = arms.mean(axis=0)
    for _ in range(20):
        rotation = best_rotations(arms, shape)
        new = np.einsum("nij,nbi->nbj", rotation, arms).mean(axis=0)
        change = np.abs(new - shape).max()
        shape = new
        if change <= 1e-15 * np.abs(new).max():
            break
    return shape


@dataclass(frozen=True)
class Rigid:
    """2: rigid states."""

    p: np.ndarray
    v: np.ndarray
    rotation: np.ndarray
    spin: np.ndarray


def rigid_states(positions, velocities, shape):
    """2: centres, velocities, rotations and spins in body axes."""
    p = positions.mean(axis=1)
    v = velocities.mean(axis=1)
    rotation = best_rotations(positions - p[:, None], shape)
    arms = np.einsum("nij,bj->nbi", rotation, shape)
    momentum = np.cross(arms, velocities - v[:, None]).sum(axis=1)
    squares = np.sum(arms**2, axis=(1, 2))
    inertia = squares[:, None, None] * np.eye(3) - np.einsum("nbi,nbj->nij", arms, arms)
    turning = np.linalg.solve(inertia, momentum[..., None])[..., 0]
    return Rigid(p, v, rotation, np.einsum("nij,ni->nj", rotation, turning))


def upright(shape, rotation):
    """2: the shape with its third axis along the mean vertical."""
    k = rotation[:, 2].mean(axis=0)
    e = np.eye(3)[np.argmin(np.abs(k))]
    first = np.cross(e, k)
    second = np.cross(k, first)
    axes = np.array([a / np.linalg.norm(a) for a in (first, second, k)])
    return shape @ axes.T


def heading(rotation):
    """2: twist about the vertical."""
    across = rotation[:, 1, 0] - rotation[:, 0, 1]
    return np.arctan2(across, rotation[:, 0, 0] + rotation[:, 1, 1])


def turned_back(vectors, angle):
    """2: vectors turned by minus the angle about the vertical."""
    c = np.cos(angle)
    s = np.sin(angle)
    turned = vectors.copy()
    turned[..., 0] = c * vectors[..., 0] + s * vectors[..., 1]
    turned[..., 1] = c * vectors[..., 1] - s * vectors[..., 0]
    return turned


def tilt(rotation):
    """2: tilt about the own heading."""
    u = turned_back(rotation[:, :, 2], heading(rotation))
    return np.column_stack([-u[:, 1], u[:, 0]])


def state_inputs(rigid):
    """2: the eight state inputs."""
    velocity = turned_back(rigid.v, heading(rigid.rotation))
    return np.hstack([tilt(rigid.rotation), velocity, rigid.spin])


def outcomes_of(pre, post, shape):
    """2: the eleven outcomes."""
    phi = heading(pre.rotation)
    step = turned_back(post.p - pre.p, phi)[:, :2]
    turn = (heading(post.rotation) - phi + np.pi) % (2 * np.pi) - np.pi
    second = shape.T @ shape / len(shape)
    to_motion = np.linalg.cholesky(np.trace(second) * np.eye(3) - second)
    angles = np.column_stack([tilt(post.rotation), turn]) @ to_motion
    velocity = turned_back(post.v, phi)
    return np.hstack([step, angles, velocity, post.spin @ to_motion])


@dataclass(frozen=True)
class Bodies:
    """2: marker states and rigid states in units of length and speed."""

    shape: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    pre: Rigid
    post: Rigid
    length: float


def bodies(study):
    """2: marker states and rigid states without units."""
    positions, velocities = markers(study.x)
    after, after_velocities = markers(study.y)
    shape = aligned_shape(positions - positions.mean(axis=1, keepdims=True))
    raw = rigid_states(positions, velocities, shape)
    shape = upright(shape, raw.rotation)
    length = np.sqrt(np.mean(shape**2))
    speed = np.sqrt(np.mean(raw.v**2))
    shape = shape / length
    pre = rigid_states(positions / length, velocities / speed, shape)
    post = rigid_states(after / length, after_velocities / speed, shape)
    return Bodies(shape, positions / length, velocities / speed, pre, post, length)


# 3. Noise of the inputs


def marker_noise(body):
    """3: variances of positions and velocities, and their covariance."""
    pre = body.pre
    arms = np.einsum("nij,bj->nbi", pre.rotation, body.shape)
    turning = np.einsum("nij,nj->ni", pre.rotation, pre.spin)
    m = body.positions - pre.p[:, None] - arms
    dm = body.velocities - pre.v[:, None] - np.cross(turning[:, None], arms)
    free = (3 * len(body.shape) - 6) * len(m)
    return np.sum(m**2) / free, np.sum(dm**2) / free, np.sum(m * dm) / free


def derivative(state, shape):
    """3: central differences of the inputs by the elements of a marker state."""
    steps = 1e-5 * np.eye(len(state))
    moved = np.vstack([state + steps, state - steps])
    inputs = state_inputs(rigid_states(*markers(moved), shape))
    up, down = np.split(inputs, 2)
    return (up - down).T / 2e-5


def noise_of_states(body):
    """3: covariance of the errors of the eight state inputs."""
    n, n_markers, _ = body.positions.shape
    position, velocity, shared = marker_noise(body)
    one = np.array([[position, shared], [shared, velocity]])
    errors = np.kron(one, np.eye(3 * n_markers))
    on_section = body.pre.p[:, 2].std() < 0.001 * np.sqrt(position)
    phi = heading(body.pre.rotation)
    found = []
    for row in range(0, n, ceil(n / 100)):
        places = turned_back(body.positions[row], phi[row])
        speeds = turned_back(body.velocities[row], phi[row])
        by_state = derivative(np.concatenate([places, speeds]).ravel(), body.shape)
        z = speeds[:, 2].mean()
        if on_section and abs(z) > 0.001:
            along = np.concatenate([speeds, np.zeros_like(speeds)]).ravel()
            heights = np.zeros_like(along)
            heights[2 : 3 * n_markers : 3] = 1 / n_markers
            by_state = by_state - np.outer(by_state @ along, heights) / z
        found.append(by_state @ errors @ by_state.T)
    return np.mean(found, axis=0)


def believable(noise, inputs):
    """3: noise that takes at most 0.7 of the variance in any direction."""
    factor = np.linalg.cholesky(regular(np.cov(inputs.T)))
    inverse = np.linalg.inv(factor)
    values, vectors = np.linalg.eigh(inverse @ noise @ inverse.T)
    axes = factor @ vectors
    return (axes * np.clip(values, 0, 0.7)) @ axes.T


# 4. Inputs and posture


def relative_feet(feet, body):
    """4: heights, and level coordinates foot by foot, in the frame of the body."""
    moved = feet / body.length - body.pre.p[:, None]
    seen = turned_back(moved, heading(body.pre.rotation)[:, None])
    return seen[:, :, 2], seen[:, :, :2].reshape(len(feet), -1)


def feet_are_worth(states, heights, t):
    """4: whether foot heights foretell contacts better than the state alone."""
    alone = expected(states, t)
    both = expected(np.hstack([states, heights]), t)
    left = alone.left
    if 1 - alone.left / alone.square < 0.1:
        left = np.mean(t**2)
    return (left - both.left) / both.square > 0.01


def in_section(study):
    """2 to 5: landings in coordinates without units."""
    body = bodies(study)
    states = state_inputs(body.pre)
    outcomes = outcomes_of(body.pre, body.post, body.shape)
    spread = np.sqrt(np.mean(np.var(study.instants, axis=1)))
    t = (study.instants - study.instants.mean(axis=1, keepdims=True)) / spread
    se = study.instants_se / spread
    noise = noise_of_states(body)
    time = scaled_time(study.time)
    kept = np.ones(len(t), dtype=bool)
    used = False
    if study.feet is not None:
        seen = np.isfinite(study.feet).all(axis=(1, 2))
        if seen.mean() >= 0.8:
            heights, level = relative_feet(study.feet, body)
            used = feet_are_worth(states[seen], heights[seen], t[seen])
    inputs = states
    n_bent = 8
    if used:
        kept = seen
        inputs = np.hstack([states, heights, level])
        n_bent = 8 + t.shape[1]
        squares = np.mean((study.feet_se[kept] / body.length) ** 2, axis=0)
        of_feet = np.concatenate([squares[:, 2], squares[:, :2].ravel()])
        whole = np.zeros((inputs.shape[1], inputs.shape[1]))
        whole[:8, :8] = noise
        whole[8:, 8:] = np.diag(of_feet)
        noise = whole
    inputs = inputs[kept]
    inputs = inputs - inputs.mean(axis=0)
    noise = believable(noise, inputs)
    fit = expected(inputs[:, :n_bent], t[kept])
    by_noise, rest = not_foretold(fit, inputs, noise, se[kept])
    outcomes = outcomes[kept]
    return Section(
        inputs=inputs,
        states=inputs[:, :8],
        n_bent=n_bent,
        outcomes=outcomes - outcomes.mean(axis=0),
        t=fit.t,
        missed=t[kept] - fit.t,
        foretold=foretold(fit, se[kept]),
        noise=noise,
        unforetold=by_noise + rest,
        rest=rest,
        bent=bend_of_section(-body.post.v[kept, 2]),
        time=time[kept],
        blocks=study.blocks[kept],
        kept=kept,
    )


# 5. Expected contacts


@dataclass(frozen=True)
class Expected:
    """5: expected instants and what was left of the measured ones."""

    t: np.ndarray
    good: np.ndarray
    errors: np.ndarray
    left: float
    square: float
    varied: float


def highest_degree(n, columns, feet):
    """5: the highest degree that has 2.5 landings a term."""
    degree = 1
    for more in (2, 3):
        if n >= 2.5 * (comb(columns + more, more) + feet * (feet - 1)):
            degree = more
    return degree


def expected(inputs, t):
    """5: instants that the inputs foretell."""
    n, feet = t.shape
    columns = whitened(inputs)
    fitted = np.tile(np.median(t, axis=0), (n, 1))
    best = None
    design = np.ones((n, 1))
    for degree in range(1, highest_degree(n, columns.shape[1], feet) + 1):
        design = np.hstack([design, monomials(columns, degree)])
        miss = np.abs(t - fitted).max(axis=1)
        good = miss <= 5 * 1.4826 * np.median(miss)
        if good.sum() <= design.shape[1]:
            good = np.ones(n, dtype=bool)
        fitted = design @ np.linalg.lstsq(design[good], t[good], rcond=None)[0]
        errors = left_out(t[good], design[good])
        left = np.mean(errors**2)
        if best is None or left < best.left:
            centred = fitted - fitted.mean(axis=1, keepdims=True)
            square = np.mean(t[good] ** 2)
            varied = np.mean((t[good] - t[good].mean(axis=0)) ** 2)
            best = Expected(centred, good, errors, left, square, varied)
    return best


def foretold(fit, se):
    """5: share of the variation of the instants that the inputs foretell."""
    q = (1 - 1 / fit.t.shape[1]) * np.mean(se**2)
    return float(np.clip(1 - (fit.left - q) / (fit.varied - q), 0, 1))


def not_foretold(fit, inputs, noise, se):
    """5: covariances of what is not foretold, by noise and by posture."""
    feet = fit.t.shape[1]
    whole = fit.errors.T @ fit.errors / fit.good.sum()
    s = regular(np.cov(inputs.T))
    true_slopes = np.linalg.solve(s - noise, s @ slopes(fit.t, inputs))
    unknown = noise - noise @ np.linalg.solve(s, noise)
    by_noise = true_slopes.T @ unknown @ true_slopes
    if whole.any():
        inverse = np.linalg.inv(np.linalg.cholesky(regular(whole)))
        largest = np.linalg.eigvalsh(inverse @ by_noise @ inverse.T)[-1]
        by_noise = by_noise / max(1.0, largest)
    else:
        by_noise = np.zeros_like(whole)
    j = np.eye(feet) - 1 / feet
    measured = j @ np.diag(np.mean(se[fit.good] ** 2, axis=0)) @ j
    values, vectors = np.linalg.eigh(whole - measured - by_noise)
    rest = (vectors * np.maximum(values, 0)) @ vectors.T
    return by_noise, rest


def bend_of_section(f):
    """5: bend of the post section near the lowest points."""
    if np.mean(f <= 0) > 0.1:
        return 0.0
    squares = f**2
    low, high = np.quantile(squares, [0.01, 0.99])
    inner = squares[(squares >= low) & (squares <= high)]
    inner = np.maximum(inner, 2.2e-16 * high)
    w = (2 * inner - low - high) / (high - low)
    cubic = np.polynomial.Polynomial.fit(w, np.sqrt(inner), 3, domain=[-1, 1])
    d = (high - low) / (4 * np.sqrt(inner))
    return float(np.sqrt(np.mean((d - cubic.deriv()(w)) ** 2) / np.mean(d**2)))


# 6. Kinks and steps


def kink_sets(feet):
    """6: sets of feet that have a kink."""
    sets = list(combinations(range(feet), 2))
    if feet == 3:
        sets.append((0, 1, 2))
    return sets


def sharp_kinks(t):
    """6: latest contact of each set."""
    return np.column_stack([t[:, s].max(axis=1) for s in kink_sets(t.shape[1])])


def is_nothing(unforetold, t):
    """6: whether what is not foretold is too little to matter."""
    return np.trace(unforetold) <= 1e-6 * np.mean(t**2)


def shown_kinks(t, unforetold):
    """6: mean of the latest contact over what is not foretold."""
    if is_nothing(unforetold, t):
        return sharp_kinks(t)
    covariance = unforetold + 1e-6 * np.mean(t**2) * np.eye(len(unforetold))
    found = []
    for s in kink_sets(t.shape[1]):
        found.append(mean_of_largest(t[:, s], covariance[np.ix_(s, s)]))
    return np.column_stack(found)


def variance_between(u, i, j):
    """6: variance of variable i less variable j."""
    return u[i, i] + u[j, j] - 2 * u[i, j]


def correlation(u, i, j, k):
    """6: correlation of i less j with i less k."""
    shared = u[i, i] - u[i, j] - u[i, k] + u[j, k]
    return shared / np.sqrt(variance_between(u, i, j) * variance_between(u, i, k))


def both_below(h, k, c):
    """6: bivariate normal distribution by Owen's T."""
    slack = np.sqrt(1 - c**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        of_h = owens_t(h, (k - c * h) / (h * slack))
        of_k = owens_t(k, (h - c * k) / (k * slack))
    apart = (h * k < 0) | ((h * k == 0) & (h + k < 0))
    return (ndtr(h) + ndtr(k)) / 2 - of_h - of_k - np.where(apart, 0.5, 0.0)


def mean_of_largest(m, u):
    """6: mean of the largest of two or three normal variables."""
    n = m.shape[1]
    total = np.zeros(len(m))

    def apart(i, j):
        return (m[:, i] - m[:, j]) / np.sqrt(variance_between(u, i, j))

    for i in range(n):
        others = [j for j in range(n) if j != i]
        largest = ndtr(apart(i, others[0]))
        if n == 3:
            c = correlation(u, i, *others)
            largest = both_below(apart(i, others[0]), apart(i, others[1]), c)
        total += m[:, i] * largest
    for i, j in combinations(range(n), 2):
        a = apart(i, j)
        term = np.sqrt(variance_between(u, i, j)) * np.exp(-(a**2) / 2)
        term = term / np.sqrt(2 * np.pi)
        for k in set(range(n)) - {i, j}:
            c = correlation(u, i, j, k)
            term = term * ndtr((apart(i, k) - c * a) / np.sqrt(1 - c**2))
        total += term
    return total


def exchanging_pairs(t):
    """6: pairs of feet of which each comes first in 20 rows."""
    found = []
    for i, j in combinations(range(t.shape[1]), 2):
        first = np.sum(t[:, i] < t[:, j])
        second = np.sum(t[:, j] < t[:, i])
        if min(first, second) >= 20:
            found.append((i, j))
    return found


def step_columns(t, unforetold, pairs):
    """6: steps of pairs of feet, averaged over what is not foretold."""
    found = np.empty((len(t), len(pairs)))
    for column, (i, j) in enumerate(pairs):
        variance = variance_between(unforetold, i, j)
        late = t[:, i] - t[:, j]
        if variance <= 1e-6 * np.mean(t**2):
            found[:, column] = np.sign(late)
        else:
            found[:, column] = 2 * ndtr(late / np.sqrt(variance)) - 1
    return found


def agreement(t, one, other):
    """8f: of two exchanges, that of the two pairs that agree least."""
    products = [
        np.mean(np.sign((t[:, i] - t[:, j]) * (t[:, k] - t[:, m])))
        for i, j in one
        for k, m in other
    ]
    return min(products, key=abs)


def merged_once(t, exchanges):
    """8f: the exchanges after the two that agree best became one, or None."""
    alike = {
        (a, b): agreement(t, exchanges[a], exchanges[b])
        for a, b in combinations(range(len(exchanges)), 2)
    }
    a, b = max(alike, key=lambda two: abs(alike[two]), default=(0, 0))
    if abs(alike.get((a, b), 0.0)) <= 0.8:
        return None
    turned = exchanges[b] if alike[a, b] > 0 else [(j, i) for i, j in exchanges[b]]
    kept = [exchange for c, exchange in enumerate(exchanges) if c != b]
    kept[a] = exchanges[a] + turned
    return kept


def visible_exchanges(t, unforetold, mixing, with_h, pairs):
    """8f: steps of the exchanges, the sharp ones, and what is visible of them."""
    exchanges = [[pair] for pair in pairs]
    while True:
        steps, sharp = (
            np.column_stack([step_columns(t, u, own).mean(axis=1) for own in exchanges])
            for u in (unforetold, 0 * unforetold)
        )
        v = visible(beside(mixing(steps), with_h), steps, 0.25)
        merged = None
        if v.shape[1] < len(exchanges):
            merged = merged_once(t, exchanges)
        if merged is None:
            return steps, sharp, v
        exchanges = merged


# 7. Smooth terms


def scaled_time(time):
    """7b: time from -1 to 1."""
    first = time.min()
    length = time.max() - first
    if length == 0:
        return np.zeros(len(time))
    return 2 * (time - first) / length - 1


def window_rows(t, share):
    """7: rows whose contacts lie nearest."""
    order = np.argsort(t.std(axis=1), kind="stable")
    return np.sort(order[: round(share * len(t))])


def block_columns(blocks):
    """7b: levels of the blocks, or None."""
    labels, counts = np.unique(blocks, return_counts=True)
    large = labels[counts >= 20]
    if len(large) < 2:
        return None
    columns = np.column_stack([blocks == label for label in large[1:]]).astype(float)
    return columns - columns.mean(axis=0)


def time_columns(s):
    """7b: trend of the session, or None."""
    if np.ptp(s) == 0:
        return None
    return np.column_stack([s, s**2 - np.mean(s**2)])


def change_column(s, c):
    """7b: a step at one instant, or None."""
    after = (s > c).astype(float)
    if min(after.sum(), len(s) - after.sum()) < 20:
        return None
    return (after - after.mean())[:, None]


def explained_by_change(s, c, states, outcomes, q):
    """7b: squared length of the outcomes that a change at c explains."""
    column = change_column(s, c)
    if column is None:
        return 0.0
    columns = beside(np.hstack([column, column * states]), q)
    return np.sum((basis(columns).T @ outcomes) ** 2)


def best_change(s, states, outcomes, lower):
    """7b: the change that explains most."""
    q = basis(lower)
    left = beside(outcomes, q)
    places = np.linspace(-1, 1, 21)
    found = [explained_by_change(s, c, states, left, q) for c in places]
    middle = places[np.argmax(found)]
    places = np.linspace(middle - 0.1, middle + 0.1, 21)
    found = [explained_by_change(s, c, states, left, q) for c in places]
    return change_column(s, places[np.argmax(found)])


def products(columns, states):
    """Return columns, and their products with the states."""
    found = [columns]
    for column in columns.T:
        found.append(column[:, None] * states)
    return np.hstack(found)


def session_columns(lower, s, blocks, states, outcomes):
    """7b: lower terms with the session's columns."""
    outcomes = outcomes * np.sqrt(halves(outcomes.var(axis=0)))
    candidates = {
        "block": block_columns(blocks),
        "time": time_columns(s),
        "change": best_change(s, states, outcomes, lower),
    }
    names = [name for name, columns in candidates.items() if columns is not None]
    least = np.mean(left_out(outcomes, lower) ** 2)
    while names:
        trials = []
        for name in names:
            alone = candidates[name]
            for columns in (alone, products(alone, states)):
                trial = np.hstack([lower, columns])
                if len(trial) >= 2.5 * trial.shape[1]:
                    error = np.mean(left_out(outcomes, trial) ** 2)
                    trials.append((error, name, trial))
        if not trials:
            break
        error, name, trial = min(trials, key=lambda found: found[0])
        if error >= 0.97 * least:
            break
        least = error
        lower = trial
        names.remove(name)
    return lower


def core_of(t, states, with_feet):
    """7c: eight columns, first those along the contact instants."""
    n = len(t)
    w = whitened(t)[:, : 3 if with_feet else 2]
    x = whitened(states)
    left, _, _ = np.linalg.svd(x - w @ (w.T @ x) / n, full_matrices=False)
    return np.hstack([w, np.sqrt(n) * left[:, : 8 - w.shape[1]]])


def third_order(core, feet):
    """7d: the columns of degree 3, scaled, and their kinds."""
    along = 1 if feet == 2 else 2
    combos = factors(8, 3)
    permutations = {1: 1, 2: 3, 3: 6}
    weights = np.array([permutations[len(set(f))] for f in combos])
    columns = monomials(core, 3) * np.sqrt(weights)
    kinds = np.array([sum(i < along for i in f) for f in combos])
    for kind in range(4):
        rows = kinds == kind
        size = np.sum(np.mean(columns[:, rows] ** 2, axis=0))
        columns[:, rows] /= np.sqrt(size)
    return columns, kinds


class Likelihood:
    """7d: restricted likelihood of variances of the kinds."""

    def __init__(self, columns, kinds, outcomes, others):
        q = basis(others)
        c = beside(columns, q)
        y = beside(outcomes, q)
        self.kinds = kinds
        self.cc = c.T @ c
        self.cy = c.T @ y
        self.yy = y.T @ y
        self.free = len(columns) - q.shape[1]
        self.known = {}

    def of(self, places):
        """Return the log likelihood of places in VARIANCES."""
        if places not in self.known:
            self.known[places] = self.computed(VARIANCES[list(places)])
        return self.known[places]

    def computed(self, g):
        """Return the log likelihood of variances of the kinds."""
        d = np.sqrt(g[self.kinds])
        k = np.eye(len(d)) + d[:, None] * self.cc * d
        factor = np.linalg.cholesky(k)
        fitted = np.linalg.solve(factor, d[:, None] * self.cy)
        left = np.linalg.slogdet(self.yy - fitted.T @ fitted)[1]
        log_det = 2 * np.sum(np.log(np.diag(factor)))
        return -0.5 * (self.free * left + len(self.yy) * log_det)


def moved(places, kind, by):
    """Return places with one of them moved, or None at the end."""
    there = places[kind] + by
    if not 0 <= there < len(VARIANCES):
        return None
    return (*places[:kind], there, *places[kind + 1 :])


def best_variances(likelihood):
    """7d: variances of the kinds of largest likelihood."""
    found = [likelihood.of((k,) * 4) for k in range(len(VARIANCES))]
    places = (int(np.argmax(found)),) * 4
    while True:
        before = places
        for kind in range(4):
            for by in (1, -1):
                there = moved(places, kind, by)
                while there and likelihood.of(there) > likelihood.of(places):
                    places = there
                    there = moved(places, kind, by)
        if places == before:
            return VARIANCES[list(places)]


class Mixing:
    """7d: multiplication with the inverse root of V."""

    def __init__(self, columns, variances):
        scaled = columns * np.sqrt(variances)
        left, values, _ = np.linalg.svd(scaled, full_matrices=False)
        self.left = left
        self.less = 1 / np.sqrt(1 + values**2) - 1

    def __call__(self, columns):
        """Return mixed columns."""
        return columns + self.left @ (self.less[:, None] * (self.left.T @ columns))


# 8. The fit


@dataclass(frozen=True)
class Scores:
    """8b: coefficients and what each landing contributes to their error."""

    b: np.ndarray
    null: np.ndarray
    full: np.ndarray


def fitted_scores(columns, outcomes, q):
    """8b: columns (mixed) fitted to outcomes (mixed) beside an orthonormal basis."""
    h = beside(columns, q)
    y = beside(outcomes, q)
    inverse = np.linalg.solve(h.T @ h, h.T)
    b = inverse @ y
    slack = 1 - np.sum(q**2, axis=1)
    slack_full = slack - np.sum(h.T * inverse, axis=0)
    y0 = y / np.sqrt(np.maximum(slack, 0.1))[:, None]
    y1 = (y - h @ b) / np.sqrt(np.maximum(slack_full, 0.1))[:, None]
    n = len(y)
    null = (inverse.T[:, :, None] * y0[:, None]).reshape(n, -1)
    full = (inverse.T[:, :, None] * y1[:, None]).reshape(n, -1)
    return Scores(b, null, full)


def visible(remainder, themselves, share, least=0.001):
    """8a: combinations of columns that show beside the smooth terms."""
    _, values, right = np.linalg.svd(remainder, full_matrices=False)
    own = np.linalg.svd(themselves, compute_uv=False)[0]
    return right[values > max(least * own, share * values[0])].T


@dataclass(frozen=True)
class Fit:
    """8: kinks and steps fitted in a window."""

    rows: np.ndarray
    v: np.ndarray
    kinks: Scores
    by_inputs: np.ndarray
    allowed: float
    left: float
    v_steps: np.ndarray
    steps: Scores | None
    allowed_steps: float
    free: np.ndarray
    mixing: Mixing
    q: np.ndarray
    shown: np.ndarray
    w3: np.ndarray
    outcomes: np.ndarray
    shown_steps: np.ndarray
    mixed_a: np.ndarray
    z: np.ndarray
    allowed_nearest: float | None = None
    noise_nearest: float = 1.0


def curvature(design, w3, outcomes):
    """8d: c."""
    columns = np.hstack([design, w3])
    n, width = columns.shape
    inverse = np.linalg.pinv(columns)
    coefficients = inverse @ outcomes
    residual = np.sum((outcomes - columns @ coefficients) ** 2, axis=0) / (n - width)
    of_w3 = slice(width - w3.shape[1], width)
    variances = np.outer(np.sum(inverse[of_w3] ** 2, axis=1), residual)
    m = np.full(w3.shape[1], 6.0)
    m[[0, -1]] = 18.0
    weights = halves(outcomes.var(axis=0))
    total = np.sum(m[:, None] * (coefficients[of_w3] ** 2 - variances) * weights)
    return np.sqrt(max(0.0, total))


def linear_terms(section, rows):
    """7a: whitened inputs of the window, and how many of them are bent."""
    inputs = section.inputs[rows]
    z = whitened(inputs[:, : section.n_bent])
    if not section.with_feet:
        return z, z.shape[1]
    level = inputs[:, section.n_bent :]
    q = basis(np.hstack([np.ones((len(z), 1)), z]))
    return np.hstack([z, whitened(beside(level, q))]), z.shape[1]


def lower_terms(section, rows, core):
    """7a: constant, linear and quadratic terms, and the number of linear ones."""
    feet = section.t.shape[1]
    z, bent = linear_terms(section, rows)
    of_squares = z[:, :bent]
    terms = comb(8 + feet + 2, 2) + feet * (feet - 1)
    if section.with_feet and len(rows) < 2.5 * terms:
        of_squares = core
    lower = np.hstack([np.ones((len(z), 1)), z, monomials(of_squares, 2)])
    return lower, z.shape[1]


def spread_in(t, rows):
    """8e: mean square of the sd of the instants over the feet."""
    return np.mean(t[rows].var(axis=1))


def fit_in_window(section, share):
    """7 and 8: kinks and steps beside smooth terms."""
    rows = window_rows(section.t, share)
    t = section.t[rows]
    feet = t.shape[1]
    outcomes = section.outcomes[rows]
    states = section.states[rows]
    core = core_of(t, states, section.with_feet)
    lower, n_linear = lower_terms(section, rows, core)
    without_fourth = session_columns(
        lower, section.time[rows], section.blocks[rows], whitened(states), outcomes
    )
    a = without_fourth
    if feet == 2:
        a = np.hstack([a, t[:, :1] ** 4])
    kinks = shown_kinks(t, section.unforetold)
    pairs = exchanging_pairs(t)
    steps = step_columns(t, section.unforetold, pairs)
    columns, kinds = third_order(core, feet)
    likelihood = Likelihood(columns, kinds, outcomes, np.hstack([a, kinks, steps]))
    mixing = Mixing(columns, best_variances(likelihood)[kinds])
    mixed_a = mixing(a)
    q = basis(mixed_a)
    share_of_pairs = 0.25 if feet > 3 else 0.0
    v = visible(beside(mixing(kinks), q), kinks, share_of_pairs)
    h = kinks @ v
    fit = fitted_scores(mixing(h), mixing(outcomes), q)
    beside_smooth = h @ fit.b
    w3 = monomials(whitened(t)[:, :2], 3)
    c = curvature(np.hstack([without_fourth, h, steps]), w3, outcomes)
    usual = spread_in(section.t, window_rows(section.t, 0.85))
    g = (spread_in(section.t, rows) / usual) ** 1.1
    least = max(0.1 * g, 4 * c**1.5)
    faded = fading(sharp_kinks(t) @ v, h, mixing, q)
    allowed = faded * (least + section.bent)
    with_h = np.hstack([q, basis(beside(mixing(h), q))])
    v_steps = np.zeros((0, 0))
    of_steps = None
    allowed_steps = 0.0
    every = visible(beside(mixing(kinks), q), kinks, 0.0)
    free = kinks @ every[:, v.shape[1] :]
    shown = np.zeros((len(rows), 0))
    if pairs:
        of_exchanges, sharp, v_steps = visible_exchanges(
            t, section.unforetold, mixing, with_h, pairs
        )
        shown = of_exchanges @ v_steps
        of_steps = fitted_scores(mixing(shown), mixing(outcomes), with_h)
        beside_smooth = beside_smooth + shown @ of_steps.b
        free = np.hstack([free, shown])
        faded = fading(sharp @ v_steps, shown, mixing, with_h)
        allowed_steps = faded * max(0.05 * g, 0.1 * (least + section.bent))
    z = lower[:, 1 : 1 + n_linear]
    by_inputs = slopes_by_inputs(
        section.inputs[rows], z, mixed_a, mixing(outcomes - beside_smooth)
    )
    return Fit(
        rows=rows,
        v=v,
        kinks=fit,
        by_inputs=by_inputs,
        allowed=allowed,
        left=left_of(allowed, section, len(rows)),
        v_steps=v_steps,
        steps=of_steps,
        allowed_steps=allowed_steps,
        free=free,
        mixing=mixing,
        q=q,
        shown=h,
        w3=w3,
        outcomes=outcomes,
        shown_steps=shown,
        mixed_a=mixed_a,
        z=z,
    )


def slopes_by_inputs(inputs, z, mixed_a, mixed_left):
    """8c: slopes by the inputs of outcomes (mixed) less kinks and steps."""
    of_z = np.linalg.lstsq(mixed_a, mixed_left, rcond=None)[0][1 : 1 + z.shape[1]]
    return slopes(z, inputs) @ of_z


def kinks_beside_steps(section, fit):
    """8h: the fit with its kinks beside the steps."""
    steps = fit.mixing(fit.shown_steps)
    q = np.hstack([fit.q, basis(beside(steps, fit.q))])
    kinks = fitted_scores(fit.mixing(fit.shown), fit.mixing(fit.outcomes), q)
    left = fit.outcomes - fit.shown @ kinks.b - fit.shown_steps @ fit.steps.b
    by_inputs = slopes_by_inputs(
        section.inputs[fit.rows], fit.z, fit.mixed_a, fit.mixing(left)
    )
    return replace(fit, kinks=kinks, by_inputs=by_inputs)


def left_of(allowed, section, n_rows):
    """8e: what smooth terms leave in the mean of many studies."""
    feet = section.t.shape[1]
    level = section.inputs.shape[1] - section.n_bent
    terms = comb(section.n_bent + 2, 2) + level + 120 + feet * (feet - 1)
    return allowed if n_rows >= 2.5 * terms else 1.5 * allowed


def fading(sharp, shown, mixing, q):
    """8e: how much fainter averaging makes columns."""
    of_sharp = np.linalg.norm(beside(mixing(sharp), q))
    return max(1.0, of_sharp / np.linalg.norm(beside(mixing(shown), q)))


# 9. The size


def orders_of(t):
    """9: orders of 20 rows or more."""
    orders, counts = np.unique(
        np.argsort(t, axis=1, kind="stable"), axis=0, return_counts=True
    )
    return orders[counts >= 20]


def slopes_of_kinks(order):
    """9: derivatives of all kinks by the instants on one order."""
    feet = len(order)
    place = np.argsort(order)
    found = []
    for s in kink_sets(feet):
        latest = max(s, key=lambda foot: place[foot])
        found.append(np.eye(feet)[latest] - 1 / feet)
    return np.array(found)


def compared(t):
    """9: differences L_c of the kinks' derivatives, and their mean L_0."""
    feet = t.shape[1]
    if feet <= 3:
        each = [slopes_of_kinks(order) for order in orders_of(t)]
        differences = [a - b for a, b in combinations(each, 2)]
        return np.array(differences), np.mean(each, axis=0)
    orders = np.argsort(t, axis=1, kind="stable")
    each = np.array([slopes_of_kinks(order) for order in orders])
    differences = []
    for i, j in exchanging_pairs(t):
        before = t[:, i] < t[:, j]
        differences.append(each[before].mean(axis=0) - each[~before].mean(axis=0))
    return np.array(differences), each.mean(axis=0)


@dataclass(frozen=True)
class Size:
    """9: what makes a size of coefficients: |`of_rows` b diag(w)^1/2|."""

    of_rows: np.ndarray
    w: np.ndarray

    def of(self, scores):
        """Return R times scores or coefficients, one row each."""
        shaped = scores.reshape(len(scores), -1, 11)
        moved_rows = np.einsum("ij,njq->niq", self.of_rows, shaped)
        return (moved_rows * np.sqrt(self.w)).reshape(len(scores), -1)


def power_of_map(section, fit, l0):
    """9: power of the mean map."""
    g = l0.T @ fit.v @ fit.kinks.b
    mean_map = section.inputs @ fit.by_inputs + section.t @ g
    by_inputs = slopes(mean_map, section.inputs)
    s = regular(np.cov(section.inputs.T))
    along = s @ by_inputs
    known_part = along.T @ np.linalg.solve(s - section.noise, along)
    return np.diag(known_part + g.T @ section.rest @ g)


def changes(section, fit):
    """9: M_c of each comparison, and the size of kinks."""
    differences, l0 = compared(section.t)
    x = root(np.cov(section.t.T) + section.unforetold)
    m = np.array([fit.v.T @ difference @ x for difference in differences])
    of_rows = root(np.mean(m @ m.transpose(0, 2, 1), axis=0))
    return m, Size(of_rows, halves(power_of_map(section, fit, l0)))


def size_of_steps(section, fit):
    """9: the size of the jumps at the exchanges."""
    exchanges, n_visible = fit.v_steps.shape
    w = halves(power_of_map(section, fit, compared(section.t)[1]))
    return Size(2 / np.sqrt(exchanges) * np.eye(n_visible), w)


def best_window(section):
    """8g: the fit in the window that is expected to show most."""
    nearest = fit_in_window(section, SHARES[0])
    of_nearest = largest_noise(section, nearest)
    best = nearest
    least = nearest.allowed + 2.5 * of_nearest
    usual = spread_in(section.t, nearest.rows)
    for share in SHARES[1:]:
        spread = spread_in(section.t, window_rows(section.t, share))
        if 0.1 * (spread / usual) ** 1.1 >= least:
            break
        wide = fit_in_window(section, share)
        noise = largest_noise(section, wide)
        if wide.allowed + 2.5 * noise < least:
            least = wide.allowed + 2.5 * noise
            best = replace(
                wide,
                allowed_nearest=nearest.allowed,
                noise_nearest=of_nearest / noise,
            )
    return best


def largest_noise(section, fit):
    """8g: noise of the size in the direction where it is largest."""
    _, size = changes(section, fit)
    return np.linalg.norm(size.of(fit.kinks.null), 2)


# 10. Random signs


def random_signs(seed, name, flips, n):
    """10: random signs of a name."""
    key = (crc32(b"verdict"), crc32(name.encode()))
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
    return 2.0 * generator.integers(0, 2, size=(flips, n)) - 1


def alike(scores):
    """10: whether successive landings err alike."""
    sums = []
    for lag in range(1, 6):
        sums.append(np.sum(scores[:-lag] * scores[lag:], axis=1))
    together = np.concatenate(sums)
    return together.sum() > 3 * np.sqrt(np.sum(together**2))


def summed(scores, by_forty):
    """10: scores, added up over 40 successive rows if landings err alike."""
    if not by_forty:
        return scores
    return np.add.reduceat(scores, np.arange(0, len(scores), 40), axis=0)


def in_all_rows(scores, rows, n):
    """8b: scores of all rows, 0 outside the window."""
    found = np.zeros((n, scores.shape[1]))
    found[rows] = scores
    return found


class Draws:
    """10: the statistic of the data and its draws at an assumed size."""

    def __init__(self, found, null, full, signs):
        self.length = np.linalg.norm(found)
        self.direction = found / self.length
        self.statistic = self.length**2
        self.null = signs @ null
        self.full = signs @ full
        self.squared = self.statistic - np.sum(full**2)

    def at(self, size):
        """Return T_s(e)."""
        a = min(1.0, size / self.length)
        errors = (1 - a) * self.null + a * self.full
        return np.sum((size * self.direction + errors) ** 2, axis=1)

    def p_value(self, size):
        """Return p(e)."""
        return (1 + np.sum(self.at(size) >= self.statistic)) / (1 + len(self.null))

    def size_at(self, statistic, share):
        """Return E(T', q)."""
        return where_falls(lambda e: np.mean(self.at(e) <= statistic), share)


def where_falls(share_at, share):
    """10: the size at which a share falls to the one given."""
    if share_at(0.0) <= share:
        return 0.0
    low = 0.0
    high = 0.001
    while share_at(high) > share and high < 1000:
        low = high
        high = 2 * high
    for _ in range(50):
        middle = (low + high) / 2
        if share_at(middle) <= share:
            high = middle
        else:
            low = middle
    return high


# 11. Levels, interval and bound


def rarest(tests, allowed):
    """11: the rarest of each pattern, first those of the draws; shares."""
    shares = [0.8, 0.2] if len(tests) == 2 else [1.0]
    places = []
    for draws, a, share in zip(tests, allowed, shares, strict=True):
        values = np.append(draws.at(a), draws.statistic)
        larger = len(values) - np.searchsorted(np.sort(values), values, side="left")
        places.append(larger / share)
    return np.min(places, axis=0), shares


def joint_levels(numbers, shares, level):
    """11: levels of the tests, and the joint p-value."""
    n = len(numbers)
    ordered = np.sort(numbers)
    up_to = np.searchsorted(ordered, ordered, side="right") / n
    within = ordered[up_to < level]
    last = within[-1] if len(within) else 0.0
    critical = (last + ordered[len(within)]) / 2
    p_value = np.mean(numbers <= numbers[-1])
    return [critical * share / n for share in shares], p_value


def interval(draws, allowed, found, level, two_sided):
    """11: low, high and upper bound of a test at `level`."""
    d = 2 * (allowed / 4) ** (2 / 3)
    t = draws.statistic
    low = 0.0
    if found:
        middle = np.median(draws.at(allowed))
        at_half = max(draws.size_at(middle, level / 2), draws.size_at(t, 1 - level / 2))
        low = max(0.0, min(draws.size_at(t, 1 - level), at_half) - allowed) / (1 + d)
    at_least = max(t, np.median(draws.at(0.0)))

    def widened(e):
        return e + np.sqrt((allowed / 2) ** 2 + (d * e) ** 2)

    high = widened(draws.size_at(at_least, two_sided / 2))
    return low, high, widened(draws.size_at(at_least, two_sided))


def detectable(noise, allowed, level, power):
    """11: the size that is found with the given power."""
    directions = noise[:64] / np.linalg.norm(noise[:64], axis=1, keepdims=True)
    along = directions @ noise.T
    squares = np.sum(noise**2, axis=1)
    at_allowed = allowed**2 + 2 * allowed * along + squares
    threshold = np.quantile(at_allowed, 1 - level, axis=1)[:, None]
    n = len(directions)
    scatter = np.exp(0.3 * ndtri((np.arange(n) + 0.5) / n))[:, None]

    def missed(e):
        sizes = e * scatter
        return np.mean(sizes**2 + 2 * sizes * along + squares <= threshold)

    return where_falls(missed, 1 - power)


def effect_of(draws, allowed, level, study):
    """10 and 11: the numbers of an effect."""
    p_value = draws.p_value(allowed)
    low, high, bound = interval(draws, allowed, p_value < level, level, study.level)
    return {
        "estimate": np.sqrt(max(0.0, draws.squared)),
        "low": low,
        "high": high,
        "upper_bound": bound,
        "detectable": detectable(draws.null, allowed, level, study.power),
        "allowed": allowed,
        "p_value": p_value,
        "squared": draws.squared,
        "squared_error": draws.at(0.0).std(),
        "along_error": (draws.full @ draws.direction).std(),
    }


@dataclass(frozen=True)
class Errors:
    """10: scores of kinks and steps over all rows, and the signs they share."""

    kinks: Scores
    steps: Scores | None
    signs: np.ndarray
    by_forty: bool


def over_rows(scores, rows, n):
    """8b: scores over all rows."""
    null = in_all_rows(scores.null, rows, n)
    return Scores(scores.b, null, in_all_rows(scores.full, rows, n))


def errors_of(section, fit, size, of_steps, study):
    """10: scores with their signs."""
    n = section.n
    kinks = over_rows(fit.kinks, fit.rows, n)
    by_forty = alike(size.of(kinks.full))
    steps = None
    if fit.steps is not None:
        steps = over_rows(fit.steps, fit.rows, n)
        by_forty = by_forty or alike(of_steps.of(steps.full))
    n_signs = ceil(n / 40) if by_forty else n
    signs = random_signs(study.seed, "signs", study.flips, n_signs)
    return Errors(kinks, steps, signs, by_forty)


def draws_of(scores, size, errors):
    """10: draws of a size."""
    null = summed(size.of(scores.null), errors.by_forty)
    full = summed(size.of(scores.full), errors.by_forty)
    return Draws(size.of(scores.b.reshape(1, -1))[0], null, full, errors.signs)


# 12. Pairs


def pair_draws(m, size, fit, of_steps, errors):
    """12: draws of each pair, with what it is of and its allowed size."""
    squares = np.sum(m**2, axis=(1, 2))
    found = []
    for change, square in zip(m, squares, strict=True):
        if square >= 0.1 * squares.mean():
            allowed = fit.allowed * np.sqrt(square / squares.mean())
            draws = draws_of(errors.kinks, Size(change.T, size.w), errors)
            found.append(("map", draws, allowed))
    for row in fit.v_steps:
        if np.sum(row**2) >= 0.1:
            draws = draws_of(errors.steps, Size(2 * row[None], of_steps.w), errors)
            found.append(("jump", draws, fit.allowed_steps))
    return found


def sizes_of_pairs(pairs, joint_p, study):
    """12: size, interval and p-value of each pair."""
    level = study.level
    flips = study.flips
    at_allowed = np.array([draws.at(allowed) for _, draws, allowed in pairs])
    q = np.quantile(at_allowed, 1 - level, axis=1)
    relative = at_allowed / q[:, None]
    largest = relative.max(axis=0)
    critical = np.quantile(largest, 1 - level, method="higher")
    found = []
    for (of, draws, allowed), values, scale in zip(pairs, relative, q, strict=True):
        p_value = (1 + np.sum(largest >= draws.statistic / scale)) / (1 + flips)
        p_value = max(p_value, joint_p)
        own = (1 + np.sum(values >= critical)) / (1 + flips)
        low, high, _ = interval(draws, allowed, p_value < level, own, own)
        estimate = np.sqrt(max(0.0, draws.squared))
        numbers = {"estimate": estimate, "low": low, "high": high, "p_value": p_value}
        found.append({"of": of, **numbers})
    return found


# 13. Saturation


def durations(t):
    """13: how long phases last."""
    feet = t.shape[1]
    if feet > 3:
        pairs = combinations(range(feet), 2)
        return np.stack([np.abs(t[..., i] - t[..., j]) for i, j in pairs], axis=-1)
    alone = []
    last = []
    for foot in range(feet):
        others = np.delete(t, foot, axis=1)
        alone.append(np.maximum(others.min(axis=1) - t[:, foot], 0))
        last.append(np.maximum(t[:, foot] - others.max(axis=1), 0))
    return np.column_stack(alone if feet == 2 else alone + last)


def latest_by_kinks(feet, sets):
    """13: the latest contact of a set by kinks, up to linear terms."""
    found = np.zeros(len(sets))
    if len(feet) > 1:
        found[sets.index(tuple(feet))] = 1
    return found


def first_by_kinks(feet, sets):
    """13: the first contact of a set by inclusion and exclusion."""
    found = np.zeros(len(sets))
    for size in range(2, len(feet) + 1):
        for subset in combinations(feet, size):
            found += (-1) ** (size + 1) * latest_by_kinks(subset, sets)
    return found


def durations_by_kinks(feet):
    """13: K, each duration by kinks."""
    sets = kink_sets(feet)
    if feet > 3:
        return 2 * np.eye(len(sets))
    every = tuple(range(feet))
    alone = []
    last = []
    for foot in every:
        others = tuple(f for f in every if f != foot)
        alone.append(first_by_kinks(others, sets) - first_by_kinks(every, sets))
        last.append(latest_by_kinks(every, sets) - latest_by_kinks(others, sets))
    return np.array(alone if feet == 2 else alone + last)


def nodes_of(feet):
    """13: nodes of a normal variable."""
    points = qmc.Sobol(feet, scramble=False).random(32)
    nodes = ndtri(points + 1 / 64)
    return (nodes - nodes.mean(axis=0)) / nodes.std(axis=0)


def delays(t):
    """13: the differences of the instants of all pairs."""
    return np.stack(
        [t[:, i] - t[:, j] for i, j in combinations(range(t.shape[1]), 2)], 1
    )


def saturating_terms(t, unforetold, tau, times=durations):
    """13: terms that saturate, averaged over what is not foretold."""
    moves = np.zeros((1, t.shape[1]))
    if not is_nothing(unforetold, t):
        moves = nodes_of(t.shape[1]) @ root(unforetold)
    return np.mean([tau * np.tanh(times(t + move) / tau) for move in moves], axis=0)


def slopes_at_contact(scores, k, through):
    """13: coefficients, or scores, of the slopes at the contact."""
    shaped = scores.reshape(len(scores), -1, 11)
    slopes_there = shaped[:, :k] + np.einsum("kd,ndq->nkq", through, shaped[:, k:])
    return slopes_there.reshape(len(scores), -1)


@dataclass(frozen=True)
class Saturating:
    """13: terms of one time constant, fitted."""

    statistic: float
    draws: np.ndarray
    misfit: float
    contact: Scores


def saturating_fit(section, fit, q, tau, signs, by_forty):
    """13: terms of one time constant beside kinks."""
    t = section.t[fit.rows]
    terms = saturating_terms(t, section.unforetold, tau)
    h = fit.mixing(fit.shown)
    y = fit.mixing(fit.outcomes)
    with_h = np.hstack([q, basis(beside(h, q))])
    d = visible(beside(fit.mixing(terms), with_h), terms, 0.01)
    shown = fit.mixing(terms @ d)
    alone = fitted_scores(shown, y, with_h)
    values, vectors = np.linalg.eigh(alone.null.T @ alone.null)
    kept = values > 1e-9**1.5 * values[-1]
    x = vectors[:, kept] / np.sqrt(values[kept])
    draws = np.sum((signs @ summed(alone.null @ x, by_forty)) ** 2, axis=1)
    both = fitted_scores(np.hstack([h, shown]), y, q)
    k = h.shape[1]
    through = fit.v.T @ durations_by_kinks(t.shape[1]).T @ d
    everything = np.hstack([with_h, basis(beside(shown, with_h))])
    left = beside(y, everything)
    flat = both.b.reshape(1, -1)
    return Saturating(
        statistic=np.sum((alone.b.ravel() @ x) ** 2),
        draws=draws,
        misfit=len(t) * np.linalg.slogdet(left.T @ left)[1],
        contact=Scores(
            slopes_at_contact(flat, k, through).reshape(k, 11),
            slopes_at_contact(both.null, k, through),
            slopes_at_contact(both.full, k, through),
        ),
    )


def saturation(section, fit, size, over_landings, study):
    """13: p-value of saturation, and the effect at the contact."""
    free = beside(fit.mixing(np.hstack([fit.free, fit.w3])), fit.q)
    q = np.hstack([fit.q, basis(free)])
    by_forty = alike(over_rows(fit.kinks, fit.rows, section.n).full)
    n = len(fit.rows)
    n_signs = ceil(n / 40) if by_forty else n
    signs = random_signs(study.seed, "saturation", study.flips, n_signs)
    fits = [saturating_fit(section, fit, q, tau, signs, by_forty) for tau in TAUS]
    largest = np.max([f.draws for f in fits], axis=0)
    statistic = max(f.statistic for f in fits)
    p_value = (1 + np.sum(largest >= statistic)) / (1 + study.flips)
    if p_value >= 0.01:
        return p_value, over_landings
    least = min(f.misfit for f in fits)
    slowest = next(f for f in fits if f.misfit <= least + 3.84)
    estimate = at_contact(section, fit, slowest.contact, size, study)["estimate"]
    end = "estimate" if section.t.shape[1] <= 3 else "high"
    if estimate <= max(fit.allowed, over_landings[end]):
        return p_value, over_landings
    unbounded = {"estimate": estimate, "high": None, "upper_bound": None}
    return p_value, over_landings | unbounded


def jumps_beside_bends(section, fit, m, size, of_steps, level, study):
    """13: the jump and the rows of jumps beside each time constant, the likeliest first."""
    t = section.t[fit.rows]
    steps = fit.free[:, fit.free.shape[1] - fit.v_steps.shape[1] :]
    faint = fit.free[:, : fit.free.shape[1] - fit.v_steps.shape[1]]
    with_kinks = beside(fit.mixing(np.hstack([fit.shown, faint])), fit.q)
    q = np.hstack([fit.q, basis(with_kinks)])
    y = fit.mixing(fit.outcomes)
    found = []
    misfits = []
    for tau in TAUS:
        bends = saturating_terms(t, section.unforetold, tau, delays)
        d = visible(beside(fit.mixing(bends), q), bends, 0.01)
        shown = beside(fit.mixing(bends @ d), q)
        beside_bends = np.hstack([q, basis(shown)])
        scores = fitted_scores(fit.mixing(steps), y, beside_bends)
        everything = np.hstack(
            [beside_bends, basis(beside(fit.mixing(steps), beside_bends))]
        )
        left = beside(y, everything)
        misfits.append(np.linalg.slogdet(left.T @ left)[1])
        found.append(over_rows(scores, fit.rows, section.n))
    by_forty = any(alike(of_steps.of(scores.full)) for scores in found)
    n_signs = ceil(section.n / 40) if by_forty else section.n
    signs = random_signs(study.seed, "jump", study.flips, n_signs)
    kinks = over_rows(fit.kinks, fit.rows, section.n)
    told = []
    for place in np.argsort(misfits, kind="stable"):
        errors = Errors(kinks, found[place], signs, by_forty)
        draws = draws_of(found[place], of_steps, errors)
        effect = effect_of(draws, fit.allowed_steps, level, study)
        effect["left"] = fit.allowed_steps
        pairs = pair_draws(m, size, fit, of_steps, errors)
        rows = sizes_of_pairs(pairs, effect["p_value"], study)
        told.append((effect, [row for row in rows if row["of"] == "jump"]))
    return told


def holding_all(numbers):
    """13: the first numbers, with ends that hold those of all."""
    found = dict(numbers[0])
    found["low"] = min(one["low"] for one in numbers)
    for name in ("high", "upper_bound", "p_value"):
        if name in found:
            found[name] = max(one[name] for one in numbers)
    return found


def only_sure_jumps(jump, rows, beside_bends, saturates):
    """13: the jump and the rows; jumps that are not told from bends have no low end."""
    if jump["low"] <= 0 and not any(r["low"] > 0 for r in rows if r["of"] == "jump"):
        return jump, rows
    effects, of_pairs = zip(*beside_bends(), strict=True)
    effect = holding_all(effects)
    pairs = [holding_all(pair) for pair in zip(*of_pairs, strict=True)]
    if effect["low"] > 0 or any(pair["low"] > 0 for pair in pairs):
        if not saturates:
            return jump, rows
        told = [pairs.pop(0) if row["of"] == "jump" else row for row in rows]
        return effect, told
    unsure = {"low": 0.0}
    p_beside = effect["p_value"]
    told = []
    for row in rows:
        if row["of"] == "jump":
            row = row | unsure | {"p_value": max(row["p_value"], p_beside)}
        told.append(row)
    return jump | unsure | {"p_value": max(jump["p_value"], p_beside)}, told


def at_contact(section, fit, slopes_there, size, study):
    """13: the size of the slopes at the contact."""
    scores = over_rows(slopes_there, fit.rows, section.n)
    by_forty = alike(size.of(scores.full))
    n_signs = ceil(section.n / 40) if by_forty else section.n
    signs = random_signs(study.seed, "contact", study.flips, n_signs)
    draws = draws_of(scores, size, Errors(scores, None, signs, by_forty))
    return effect_of(draws, fit.allowed, study.level, study)


def lasting(section, fit):
    """13: time constants, slow ones first, and the shares of kinks that show."""
    t = section.t[fit.rows]
    bends = beside(fit.mixing(sharp_kinks(t) @ fit.v), fit.q)
    gram = bends.T @ bends
    size = root(gram)
    to_kinks = np.linalg.pinv(durations_by_kinks(t.shape[1]).T) @ fit.v
    taus = np.geomspace(100, 0.01, 24)
    shares = []
    for tau in taus:
        columns = tau * np.tanh(durations(t) / tau) @ to_kinks
        by_bends = np.linalg.solve(gram, bends.T @ beside(fit.mixing(columns), fit.q))
        relative = size @ by_bends @ np.linalg.inv(size)
        shares.append(np.linalg.norm(relative) / np.sqrt(len(gram)))
    return taus, np.minimum.accumulate(shares)


def holds_from(section, fit, share):
    """13: the time constant of which this share shows, in contact spreads, or None."""
    taus, shares = lasting(section, fit)
    if shares[0] < share:
        return None
    if shares[-1] >= share:
        return taus[-1]
    following = int(np.argmax(shares < share))
    ends = [following, following - 1]
    return float(np.exp(np.interp(share, shares[ends], np.log(taus[ends]))))


def of_nearest(draws, fit, level, study):
    """11: what the nearest landings alone would allow for and detect."""
    if fit.allowed_nearest is None:
        own = detectable(draws.null, fit.allowed, level, study.power)
        return {"allowed_nearest": fit.allowed, "detectable_nearest": own}
    noise = fit.noise_nearest * draws.null
    there = detectable(noise, fit.allowed_nearest, level, study.power)
    return {"allowed_nearest": fit.allowed_nearest, "detectable_nearest": there}


def landings_needed(n, effect, feet):
    """11: landings that show 0.2, or None."""
    for_terms = (45 + feet * (feet - 1)) / 0.85
    needs = []
    for window in ("", "_nearest"):
        a = effect["allowed" + window]
        if a < 0.2:
            beyond = max(0.0, effect["detectable" + window] - a) / (0.2 - a)
            needs.append(ceil(for_terms + (n - for_terms) * beyond**2))
    if not needs:
        return None
    fewest = ceil(2.5 * for_terms)
    return max(fewest, min(needs))


# The verdict


def conclusion(effect, jump, margin):
    """14: the answer in words."""
    if effect["low"] > 0 or (jump is not None and jump["low"] > 0):
        return "different"
    if effect["upper_bound"] is not None and effect["upper_bound"] <= margin:
        return "no difference"
    return "cannot tell"


@dataclass(frozen=True)
class Sizes:
    """11 and 12: the sizes of a fit, with their levels and rows."""

    m: np.ndarray
    size: "Size"
    of_steps: "Size | None"
    levels: list[float]
    effects: list[dict[str, float]]
    rows: list[dict[str, float]]


def sizes_of(section, fit, study):
    """9 to 12: the sizes of kinks and steps, and of each pair."""
    m, size = changes(section, fit)
    of_steps = None
    if fit.steps is not None:
        of_steps = size_of_steps(section, fit)
    errors = errors_of(section, fit, size, of_steps, study)
    tests = [draws_of(errors.kinks, size, errors)]
    allowed = [fit.allowed]
    if errors.steps is not None:
        tests.append(draws_of(errors.steps, of_steps, errors))
        allowed.append(fit.allowed_steps)
    levels, joint_p = joint_levels(*rarest(tests, allowed), study.level)
    effects = []
    for draws, a, level in zip(tests, allowed, levels, strict=True):
        effects.append(effect_of(draws, a, level, study))
    effects[0]["left"] = fit.left
    effects[0] |= of_nearest(tests[0], fit, levels[0], study)
    pairs = pair_draws(m, size, fit, of_steps, errors)
    rows = sizes_of_pairs(pairs, joint_p, study)
    return Sizes(m, size, of_steps, levels, effects, rows)


def found_jump(jump, rows):
    """13: whether a jump is found, of all exchanges or of one."""
    of_one = any(row["of"] == "jump" and row["low"] > 0 for row in rows)
    return of_one or (jump is not None and jump["low"] > 0)


def verdict(x, y, instants, seed, **options):
    """Return the numbers of a verdict by name."""
    study = known(Study(x, y, instants, seed, **options))
    section = searched(study)
    fit = best_window(section)
    sizes = sizes_of(section, fit, study)
    effects = sizes.effects
    levels = sizes.levels
    rows = sizes.rows
    jump = None
    if len(effects) == 2:
        jump = effects[1] | {"left": fit.allowed_steps}
    p_value, effect = saturation(section, fit, sizes.size, effects[0], study)
    if jump is not None and p_value < 0.01:

        def beside_bends():
            return jumps_beside_bends(
                section, fit, sizes.m, sizes.size, sizes.of_steps, levels[1], study
            )

        saturates = effect["high"] is None
        jump, rows = only_sure_jumps(jump, rows, beside_bends, saturates)
    if found_jump(jump, rows):
        fit = kinks_beside_steps(section, fit)
        again = sizes_of(section, fit, study)
        effects = again.effects
        levels = [again.levels[0], levels[1]]
        jumps = [row for row in rows if row["of"] == "jump"]
        rows = [row for row in again.rows if row["of"] == "map"] + jumps
        p_value, effect = saturation(section, fit, again.size, effects[0], study)
    spread = np.sqrt(np.mean(np.var(study.instants, axis=1)))
    share = effects[0]["upper_bound"] / study.margin
    holds = holds_from(section, fit, share)
    found = effect["low"] > 0 and effect["high"] is not None
    half = holds_from(section, fit, 0.5) if found else None
    needed = landings_needed(section.n, effect, study.instants.shape[1])
    if jump is not None and jump["low"] > 0 and effect["low"] == 0:
        needed = None
    return {
        "conclusion": conclusion(effect, jump, study.margin),
        "contact_spread": spread,
        "holds_from": None if holds is None else holds * spread,
        "twice_high_from": None if half is None else half * spread,
        "landings_needed": needed,
        "n_landings": section.n,
        "n_window": len(fit.rows),
        "contacts_r2": section.foretold,
        "effect_over_landings": effects[0],
        "effect": effect,
        "jump": jump,
        "levels": levels,
        "saturation_p_value": p_value,
        "orders": rows,
    }
