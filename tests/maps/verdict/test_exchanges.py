"""Pairs of feet that exchange their order together count as one exchange."""

import numpy as np
import pytest
from kinked_landings import landings

from hopdata.maps.verdict import judge
from hopdata.maps.verdict.averaged import steps
from hopdata.maps.verdict.exchanges import TOGETHER, exchanges_of, steps_of

PAIRS = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]


def _instants(apart):
    """Return instants of four feet; feet 4 and 3 are `apart` from feet 1 and 2."""
    rng = np.random.default_rng(1)
    t = rng.standard_normal((500, 4))
    t[:, 3] = t[:, 2] + t[:, 0] - t[:, 1] + apart * t[:, 3]
    return t


def test_pairs_that_exchange_together_are_one_with_one_direction():
    t = _instants(0.01)
    found = exchanges_of(PAIRS, t, lambda exchanges: len(exchanges) < 6)
    assert ((0, 1), (3, 2)) in found or ((0, 3), (1, 2)) in found
    assert len(found) == 5
    found = exchanges_of(PAIRS, t, lambda _: False)
    assert set(found) == {((0, 1), (3, 2)), ((0, 3), (1, 2)), ((0, 2),), ((1, 3),)}
    of_pairs = steps(t, np.zeros((4, 4)), PAIRS)
    together = steps_of(found, of_pairs)[:, found.index(((0, 1), (3, 2)))]
    np.testing.assert_allclose(together, 0.5 * (of_pairs[:, 0] - of_pairs[:, 5]))


def test_pairs_that_landings_tell_apart_stay_alone():
    alone = [(pair,) for pair in PAIRS]
    assert exchanges_of(PAIRS, _instants(0.01), lambda _: True) == alone
    assert exchanges_of(PAIRS, _instants(3.0), lambda _: False) == alone
    signs = np.sign(_instants(3.0)[:, :2] - _instants(3.0)[:, [3, 2]])
    assert abs(np.mean(signs.prod(axis=1))) < TOGETHER


@pytest.mark.parametrize(("parallel", "name"), [(True, "1>2, 4>3"), (False, "1>2")])
def test_the_jump_at_an_exchange_has_its_whole_size(parallel, name):
    """Twice the jump has four times its square, whatever pairs it is shared out over."""
    sizes = []
    for jump in (0.2, 0.4):
        data = landings(n=600, jump=jump, feet=4, parallel=parallel, curvature=0.0)
        answer = judge(data.before, data.after, data.instants, seed=3, flips=199)
        rows = {row["first"]: row for row in answer.orders if row["of"] == "jump"}
        assert rows[name]["low"] > 0.0
        sizes.append(rows[name]["estimate"])
        others = [row["low"] for first, row in rows.items() if first != name]
        assert others == [0.0] * len(others)
        in_all = sizes[-1] / np.sqrt(len(rows))
        assert answer.jump.estimate == pytest.approx(in_all, rel=0.05)
    assert sizes[1] == pytest.approx(2.0 * sizes[0], rel=0.05)
