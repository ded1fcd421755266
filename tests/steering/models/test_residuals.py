"""What contact orders explain of a residual: cases in which the answer is known."""

import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.steering.models import residuals
from steering.made_hops import made_hops

HOPS = 900


def explained(share, *, slope=False, n=600, seed=0, resamples=100):
    """Return what two classes explain if this share of the residual is theirs."""
    rng = np.random.default_rng(seed)
    known = rng.standard_normal((n, 2))
    second = rng.integers(2, size=n)
    theirs = (2.0 * second - 1)[:, None]
    if slope:
        theirs = theirs * known[:, :1]
    rest = rng.standard_normal((n, 1))
    response = known @ [[1.0], [2.0]]
    response = response + np.sqrt(share) * theirs + np.sqrt(1 - share) * rest
    given = np.column_stack([np.ones(n), known])
    slopes = known if slope else None
    return residuals.explained_by(
        np.where(second, "b", "a"),
        response,
        given,
        slopes=slopes,
        permutations=99,
        resamples=resamples,
    )


@pytest.mark.parametrize("slope", [False, True])
@pytest.mark.parametrize("share", [0.1, 0.4])
def test_a_share_of_the_classes_is_found_with_its_interval(share, slope):
    found = explained(share, slope=slope)
    assert found.low[0] < share < found.high[0]
    assert found.share[0] == pytest.approx(share, abs=0.08)
    assert found.p[0] == 1 / 100
    # The residual has a variance of 1.
    assert found.effect[0] == pytest.approx(np.sqrt(share), abs=0.1)
    assert found.n_classes == 2


def test_classes_that_do_not_matter_explain_nothing():
    """The p-values are spread evenly, and the shares are about zero."""
    found = [explained(0.0, n=120, seed=seed, resamples=40) for seed in range(40)]
    p = np.array([one.p[0] for one in found])
    shares = np.array([one.share[0] for one in found])
    assert 0 <= (p <= 0.05).sum() <= 6  # 2 are expected
    assert 0.3 < p.mean() < 0.7
    assert abs(shares.mean()) < 3 * shares.std() / np.sqrt(len(shares))
    covers = [one.low[0] < 0 < one.high[0] for one in found]
    assert np.mean(covers) > 0.7


def test_what_is_given_is_not_counted_again():
    """Classes that only repeat what is given add nothing, however well they tell it."""
    rng = np.random.default_rng(0)
    known = rng.standard_normal(500)
    response = (3 * np.sign(known) + 0.1 * rng.standard_normal(500))[:, None]
    classes = np.where(known > 0, "up", "down")
    blind = residuals.explained_by(
        classes, response, np.ones((500, 1)), permutations=99
    )
    assert blind.share[0] > 0.99
    given = np.column_stack([np.ones(500), np.sign(known)])
    seeing = residuals.explained_by(classes, response, given, permutations=99)
    assert seeing.share[0] == pytest.approx(0.0, abs=1e-6)


def test_rare_classes_are_one():
    classes = ["a"] * 30 + ["b"] * 12 + ["c"] * 5 + ["d"] * 4
    contrasts = residuals.class_contrasts(classes)
    assert contrasts.shape == (51, 2)
    assert contrasts.sum(axis=0).tolist() == [12, 9]


def test_too_few_hops_are_an_error():
    with pytest.raises(AnalysisError, match="at least 33 hops"):
        residuals.explained_by(
            ["a", "b"] * 15, np.zeros((30, 1)), np.ones((30, 10)), permutations=9
        )


def shares(hops, order="landing"):
    """Return share and p of an order, without and with the state, (2, 3) each."""
    table = residuals.order_effects(hops, permutations=49, resamples=0, orders=[order])
    wide = table.pivot_table(index="given", columns="component", values=["share", "p"])
    rows = wide.loc[[residuals.INPUTS, residuals.STATE]]
    names = ["dx", "dy", "dtheta"]
    return rows["share"][names].to_numpy(), rows["p"][names].to_numpy()


def test_an_order_that_only_tells_of_a_hidden_state_explains_nothing_given_it():
    share, p = shares(made_hops(HOPS, by_state=1.0))
    assert (share[0] > 0.5).all()
    assert (p[0] == 1 / 50).all()
    assert (np.abs(share[1]) < 0.06).all()


def test_an_order_that_matters_still_does_given_the_state():
    share, p = shares(made_hops(HOPS, by_state=1.0, by_order=1.0, order_of_state=False))
    assert (share[1] > 0.5).all()
    assert (p[1] == 1 / 50).all()


def test_an_order_that_does_not_matter_explains_nothing_either_way():
    share, p = shares(made_hops(HOPS, by_state=1.0), order="lift-off")
    assert (np.abs(share) < 0.06).all()
    assert p.min() > 1 / 50


def test_effects_are_in_mm_and_degrees():
    hops = made_hops(HOPS, by_order=1.0, order_of_state=False)
    table = residuals.order_effects(
        hops, permutations=9, resamples=0, orders=["landing"]
    )
    blind = table[table["given"] == residuals.INPUTS].set_index("component")
    # Offsets of 10 mm, -10 mm and none in x, of no, 1.15 and -1.15 degrees in heading.
    assert blind.loc["dx", "effect"] == pytest.approx(10 * np.sqrt(2 / 3), rel=0.1)
    degrees = np.degrees(0.02) * np.sqrt(2 / 3)
    assert blind.loc["dtheta", "effect"] == pytest.approx(degrees, rel=0.1)


def decided(hops):
    table = residuals.decided_by(hops)
    return table.pivot_table(index="known", columns="component", values="share")


def test_a_zero_order_change_is_decided_by_boom_angle_and_swing():
    share = decided(made_hops(HOPS, noise=1e-4))
    assert (share > 0.99).all().all()


def test_what_the_state_decides_is_told():
    share = decided(made_hops(HOPS, by_state=1.0, noise=1e-4))
    assert (share.loc[residuals.BY_INPUTS] < 0.9).all()
    assert (share.loc[residuals.BY_STATE] > 0.99).all()
    # The state that matters is neither the swing before nor the velocity.
    gain = share.loc[[residuals.BY_HISTORY, residuals.BY_MOMENTUM]]
    gain = gain - share.loc[residuals.BY_INPUTS]
    assert gain.abs().max().max() < 0.03
    with pytest.raises(AnalysisError, match="at least"):
        residuals.decided_by(made_hops(100))


@pytest.mark.parametrize(("kind", "power"), [("first order", 1), ("second order", 2)])
def test_the_order_gain_falls_with_its_power(kind, power):
    """A kink at the change of order is of first order, a jump of curvature of second."""
    gains = []
    for scale in (0.2, 0.05):
        rng = np.random.default_rng(1)
        hops = made_hops(600, noise=0.0, seed=2)
        state = scale * rng.standard_normal((600, 12))
        apart = state[:, 4]
        bent = np.abs(apart)
        if kind == "second order":
            bent = np.abs(apart) * apart
        change = 0.01 * (state @ rng.standard_normal((12, 3))) + 0.01 * bent[:, None]
        hops.changes.change[:] = change
        hops.apex[:] = state
        hops.landing[:] = np.where(apart > 0, "1>2>3", "2>3>1")
        gains.append(residuals.order_gain(hops))
    (large, wide), (small, narrow) = gains
    powers = np.log(large / small) / np.log(wide / narrow)
    np.testing.assert_allclose(powers, power, atol=0.15)
