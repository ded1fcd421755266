"""Four simpler methods that say whether contact orders have different maps.

Each is what a careful analyst would write in fifteen lines, and gets the same states and
measured instants as the verdict. Each returns a statistic, which is larger the more the
orders differ, and whether the method itself calls the maps different (at 5 % where it
has a level). `RIVALS` holds them.
"""

from collections.abc import Callable
from itertools import combinations, combinations_with_replacement

import numpy as np

LEAST_CLASS = 20  # landings of an order
FLIPS = 199
FOLDS = 5
N_INPUTS, N_OUTPUTS = 8, 11  # numbers of a rigid body at the two sections
SURE = 1.645  # standard errors, one-sided 5 %

Data = tuple[np.ndarray, np.ndarray, np.ndarray, np.random.Generator]


def principal(states: np.ndarray, count: int) -> np.ndarray:
    """Return the leading components (n, count) of the standardised states, of sd one."""
    scaled = (states - states.mean(axis=0)) / states.std(axis=0)
    left, _, _ = np.linalg.svd(scaled, full_matrices=False)
    return left[:, :count] * np.sqrt(len(states))


def powers(u: np.ndarray, degrees: range) -> np.ndarray:
    """Return a constant and all monomials of these degrees."""
    columns = [np.ones(len(u))]
    for degree in degrees:
        for chosen in combinations_with_replacement(range(u.shape[1]), degree):
            columns.append(np.prod(u[:, chosen], axis=1))
    return np.column_stack(columns)


def rest_of(design: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return what a design leaves of columns."""
    basis, _ = np.linalg.qr(design)
    return columns - basis @ (basis.T @ columns)


def common_orders(instants: np.ndarray) -> np.ndarray:
    """Return the number of each landing's contact order; -1 if it is rare.

    Rare orders are one class together, or belong to the commonest if they are few.
    """
    order = np.argsort(instants, axis=1)
    _, label, counts = np.unique(order, axis=0, return_inverse=True, return_counts=True)
    label = label.ravel()
    common = np.where(counts[label] >= LEAST_CLASS, label, -1)
    if np.sum(common < 0) < LEAST_CLASS:
        common[common < 0] = np.argmax(counts)
    return common


def with_slopes(x: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Return affine terms of their own for each label."""
    terms = powers(x, range(1, 2))
    own = [terms * (labels == one)[:, None] for one in np.unique(labels)]
    return np.hstack(own)


def errors_of_folds(design: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the squared errors (n,) of predictions of left-out landings."""
    n = len(y)
    errors = np.zeros(n)
    for k in range(FOLDS):
        out = np.arange(n) % FOLDS == k
        fit = np.linalg.lstsq(design[~out], y[~out], rcond=None)[0]
        errors[out] = np.sum((y[out] - design[out] @ fit) ** 2, axis=1)
    return errors


def kinks_and_steps(data: Data) -> tuple[float, bool]:
    """Fit kinks and steps of all pairs of feet beside cubic terms; flip signs.

    The instants are those expected from the states (second order).
    """
    x, y, instants, rng = data
    expected = instants - rest_of(powers(x, range(1, 3)), instants)
    highest = 3
    if len(x) < 2 * powers(x[:1], range(1, 4)).shape[1]:
        highest = 2
    columns = []
    for i, j in combinations(range(instants.shape[1]), 2):
        apart = expected[:, i] - expected[:, j]
        columns += [np.abs(apart), np.sign(apart)]
    smooth = powers(x, range(1, highest + 1))
    bends, _ = np.linalg.qr(rest_of(smooth, np.column_stack(columns)))
    rest = rest_of(smooth, y)
    rest = rest / rest.std(axis=0)
    found = np.sum((bends.T @ rest) ** 2)
    signs = rng.choice([-1.0, 1.0], (FLIPS, len(x)))
    drawn = [np.sum(((bends.T * sign) @ rest) ** 2) for sign in signs]
    p_value = (1 + np.sum(np.array(drawn) >= found)) / (1 + FLIPS)
    return float(found / np.median(drawn)), bool(p_value < 0.05)


def cross_validated_gain(data: Data) -> tuple[float, bool]:
    """Predict left-out landings with quadratic maps, with and without own slopes."""
    x, y, instants, _ = data
    labels = common_orders(instants)
    shared = powers(x, range(1, 3))
    without = errors_of_folds(shared, y)
    own = errors_of_folds(np.hstack([shared, with_slopes(x, labels)]), y)
    gain = without - own
    score = np.mean(gain) / (np.std(gain) / np.sqrt(len(gain)))
    return float(score), bool(score > SURE)


def chow(data: Data) -> tuple[float, bool]:
    """Test whether affine maps of the orders fit better than one; permute the orders."""
    x, y, instants, rng = data
    terms = powers(x, range(1, 2))
    labels = common_orders(instants)
    member = (labels[:, None] == np.unique(labels)).astype(float)
    squares = np.einsum("ni,nj->nij", terms, terms).reshape(len(x), -1)
    products = np.einsum("ni,nk->nik", terms, y).reshape(len(x), -1)

    def explained(of: np.ndarray) -> float:
        """Return the sum of squares that the maps of these classes explain."""
        gram = (of.T @ squares).reshape(-1, terms.shape[1], terms.shape[1])
        onto = (of.T @ products).reshape(len(gram), terms.shape[1], -1)
        return float(np.sum(onto * np.linalg.solve(gram, onto)))

    found = explained(member)
    drawn = [explained(rng.permutation(member)) for _ in range(FLIPS)]
    p_value = (1 + np.sum(np.array(drawn) >= found)) / (1 + FLIPS)
    return float((found - np.mean(drawn)) / np.std(drawn).clip(1e-9)), bool(
        p_value < 0.05
    )


def pooled_over_specialised(data: Data) -> tuple[float, bool]:
    """Compare the errors of one affine map and of one for each order, as Fig. 2.4 does."""
    x, y, instants, _ = data
    labels = common_orders(instants)
    pooled = errors_of_folds(powers(x, range(1, 2)), y)
    specialised = errors_of_folds(with_slopes(x, labels), y)
    ratio = np.sqrt(np.mean(pooled) / np.mean(specialised))
    return float(ratio), bool(ratio > 1.0)


RIVALS: dict[str, Callable[[Data], tuple[float, bool]]] = {
    "kinks_and_steps": kinks_and_steps,
    "cross_validated_gain": cross_validated_gain,
    "chow": chow,
    "pooled_over_specialised": pooled_over_specialised,
}


def rivals(
    x: np.ndarray, y: np.ndarray, instants: np.ndarray, seed: int
) -> dict[str, tuple[float, bool]]:
    """Return what each method says of marker states (n, 6 B) and instants (n, F)."""
    before = principal(x, N_INPUTS)
    after = principal(y, N_OUTPUTS)
    own = np.random.SeedSequence(seed).spawn(len(RIVALS))
    told = {}
    for (name, method), source in zip(RIVALS.items(), own, strict=True):
        told[name] = method((before, after, instants, np.random.default_rng(source)))
    return told
