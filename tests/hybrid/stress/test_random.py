"""A thousand random event-selected systems against exact or 30-digit references."""

from __future__ import annotations

import pytest
from stress_case import judge
from stress_known import KNOWN_AFFINE, KNOWN_CONSTANT, ZENO_IN_A_CROWD
from stress_random import random_case

CONSTANT, AFFINE, BLOCK = 900, 100, 50


@pytest.mark.parametrize("first", range(0, CONSTANT, BLOCK))
def test_piecewise_constant(first):
    assert wrong(first, KNOWN_CONSTANT, affine=False) == []


@pytest.mark.parametrize("first", range(0, AFFINE, BLOCK))
def test_piecewise_affine(first):
    assert wrong(first, KNOWN_AFFINE, affine=True) == []


def wrong(first, known, *, affine):
    """Return the cases of a block, but for those known to fail, that do not end right."""
    seeds = [seed for seed in range(first, first + BLOCK) if seed not in known]
    verdicts = {seed: judge(random_case(seed, affine=affine)) for seed in seeds}
    return [(seed, verdict) for seed, verdict in verdicts.items() if not verdict.right]


@pytest.mark.xfail(strict=True, reason=ZENO_IN_A_CROWD)
@pytest.mark.parametrize(
    ("seed", "affine"),
    [*((seed, False) for seed in KNOWN_CONSTANT), *((seed, True) for seed in KNOWN_AFFINE)],
)
def test_known_to_fail(seed, affine):
    verdict = judge(random_case(seed, affine=affine))
    assert verdict.right, verdict
