"""A thousand random event-selected systems against exact or 30-digit references."""

from __future__ import annotations

import pytest
from stress_case import judge
from stress_known import KNOWN_SEEDS, ZENO_IN_A_CROWD
from stress_random import random_case

CONSTANT, AFFINE, BLOCK = 900, 100, 50


@pytest.mark.parametrize("first", range(0, CONSTANT, BLOCK))
def test_piecewise_constant(first):
    cases = [
        random_case(seed, affine=False) for seed in {*range(first, first + BLOCK)} - KNOWN_SEEDS
    ]
    assert not [verdict for case in cases if not (verdict := judge(case)).right]


@pytest.mark.parametrize("first", range(0, AFFINE, BLOCK))
def test_piecewise_affine(first):
    cases = [random_case(seed, affine=True) for seed in range(first, first + BLOCK)]
    assert not [verdict for case in cases if not (verdict := judge(case)).right]


@pytest.mark.xfail(strict=True, reason=ZENO_IN_A_CROWD)
@pytest.mark.parametrize("seed", sorted(KNOWN_SEEDS))
def test_piecewise_constant_known_to_fail(seed):
    verdict = judge(random_case(seed, affine=False))
    assert verdict.right, verdict
