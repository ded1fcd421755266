"""A thousand random event-selected systems against exact or 30-digit references."""

from __future__ import annotations

import pytest
from stress_case import judge, turned_back
from stress_random import random_case

CONSTANT, AFFINE, BLOCK = 900, 100, 50


@pytest.mark.parametrize("first", range(0, CONSTANT, BLOCK))
def test_piecewise_constant(first):
    assert wrong(first, affine=False) == []


@pytest.mark.parametrize("first", range(0, AFFINE, BLOCK))
def test_piecewise_affine(first):
    assert wrong(first, affine=True) == []


@pytest.mark.parametrize("affine", [False, True])
def test_back_from_the_end(affine):
    assert wrong(0, affine=affine, seen=turned_back) == []


def wrong(first, *, affine, seen=lambda case: case):
    """Return the cases of a block that do not end right."""
    seeds = range(first, first + BLOCK)
    verdicts = {seed: judge(seen(random_case(seed, affine=affine))) for seed in seeds}
    return [(seed, verdict) for seed, verdict in verdicts.items() if not verdict.right]
