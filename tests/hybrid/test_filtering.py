"""A Kalman filter through contacts, against closed forms and against the truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from hopdata.hybrid import System, field, guards, solve
from hopdata.hybrid.filtering import Estimate, SaltationFilter, confidence_limit

GRAVITY = 10.0
PUSH, STOP = 0, 1  # parameters: push of the ground, height at which the fall ends


@field
def drop(t, y, mode, params, dy):
    """Height and its rate; the ground pushes with a force that is there at once."""
    dy[0] = y[1]
    dy[1] = -10.0
    if mode[0] > 0:
        dy[1] += params[0]


@guards
def ground(t, y, dy, mode, params, h, hdot):
    h[0] = -y[0]
    hdot[0] = -dy[0]
    h[1] = params[1] - y[0]
    hdot[1] = -dy[0]


DROP = System(
    drop, ground, n_states=2, guard_names=("ground", "stop"), terminal=(False, True)
)
NO_STOP = -1e3
START = Estimate(
    0.0, np.array([0.1, -2.0]), np.diag([0.01**2, 0.02**2]), np.array([-1, -1])
)
AT_GROUND = np.sqrt(2.0**2 + 2 * GRAVITY * 0.1)  # speed
HEIGHT = np.array([[1.0, 0.0]])


def filters(push, stop=NO_STOP, **options):
    return {
        saltation: SaltationFilter(
            DROP, params=[push, stop], saltation=saltation, rtol=1e-11, **options
        )
        for saltation in (True, False)
    }


def test_without_events_it_is_the_kalman_filter():
    q = np.array([[0.0, 0.0], [0.0, 0.5]])
    step, noise = 0.02, np.array([[1e-4]])
    flow = np.array([[1.0, step], [0.0, 1.0]])
    for one in filters(30.0, noise_density=q).values():
        found = one.predict(START, step)
        p = flow @ START.covariance @ flow.T + q * step
        mean = [0.1 - 2.0 * step - 0.5 * GRAVITY * step**2, -2.0 - GRAVITY * step]
        np.testing.assert_allclose(found.mean, mean, atol=1e-12)
        np.testing.assert_allclose(found.covariance, p, rtol=1e-8)
        after = one.update(found, [mean[0] + 0.01], HEIGHT, noise)
        inverse = np.linalg.inv(p) + HEIGHT.T @ np.linalg.inv(noise) @ HEIGHT
        np.testing.assert_allclose(after.covariance, np.linalg.inv(inverse), rtol=1e-8)
        gain = after.covariance @ HEIGHT.T / noise[0, 0]
        np.testing.assert_allclose(after.mean, mean + gain[:, 0] * 0.01, rtol=1e-8)


@pytest.mark.parametrize("push", [0.0, 30.0])
def test_the_covariance_of_a_landing(push):
    """Who lands later by dt is slower by push dt: dt is the height over the speed."""
    exact = Estimate(0.0, START.mean, np.diag([0.01**2, 0.0]), START.mode)
    found = {name: one.predict(exact, 0.1) for name, one in filters(push).items()}
    by_time = (push * 0.01 / AT_GROUND) ** 2
    assert found[True].covariance[1, 1] == pytest.approx(by_time, rel=1e-6, abs=1e-12)
    assert found[False].covariance[1, 1] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(found[True].mean, found[False].mean, rtol=1e-14)
    assert found[True].mode.tolist() == [1, -1]


def test_its_confidence_is_right_with_saltation_and_not_without():
    rng = np.random.default_rng(5)
    chol = np.linalg.cholesky(START.covariance)
    limit = confidence_limit(2, share=0.9)
    for push, least in ((30.0, 0.15), (0.0, None)):
        found = {name: one.predict(START, 0.12) for name, one in filters(push).items()}
        errors = {True: [], False: []}
        for draw in rng.normal(size=(200, 2)):
            truth = solve(
                DROP, (0.0, 0.12), START.mean + chol @ draw, params=[push, NO_STOP]
            ).y_end
            for name, one in found.items():
                errors[name].append(one.normalised_error(truth))
        shares = {name: np.mean(np.array(of) > limit) for name, of in errors.items()}
        assert 0.05 <= shares[True] <= 0.15
        if least is None:
            assert shares[False] == pytest.approx(shares[True], abs=0.01)
        else:
            assert shares[False] > least
            assert np.mean(errors[False]) > 2 * np.mean(errors[True])


@pytest.mark.parametrize(("shift", "mode"), [(0.004, 1), (-0.004, -1)])
def test_a_measurement_takes_the_mean_to_the_other_mode(shift, mode):
    """A mean just above or below the ground in the wrong mode gets what it has missed."""
    speed = 2.0
    wrong = Estimate(
        1.0, np.array([-shift, -speed]), np.diag([1e-4, 1e-4]), np.array([-mode, -1])
    )
    for saltation, one in filters(30.0).items():
        # A measurement that agrees with the mean changes nothing else.
        found = one.update(wrong, [-shift], HEIGHT, [[1e6]])
        assert found.mode.tolist() == [mode, -1]
        # Below, the push has been missed; above, it has been there too early, and the
        # two fields meet at the ground.
        expected = [-shift, -speed + 30.0 * abs(shift) / speed]
        np.testing.assert_allclose(found.mean, expected, atol=1e-9)
        salted = np.eye(2)
        if saltation:
            salted[1, 0] = mode * 30.0 / -speed
        np.testing.assert_allclose(
            found.covariance, salted @ wrong.covariance @ salted.T, rtol=1e-6
        )


def test_a_mean_on_its_side_stays_in_its_mode():
    one = filters(30.0)[True]
    right = Estimate(1.0, np.array([0.004, -2.0]), np.eye(2) * 1e-4, np.array([-1, -1]))
    found = one.update(right, [0.004], HEIGHT, [[1e6]])
    assert found.mode.tolist() == [-1, -1]
    np.testing.assert_allclose(found.mean, right.mean, atol=1e-9)


def test_an_event_that_ends_an_integration_does_not_end_the_prediction():
    whole = filters(0.0)[True].predict(START, 0.1)
    stopped = filters(0.0, stop=0.05)[True].predict(START, 0.1)
    assert stopped.t == whole.t == 0.1
    assert stopped.mode.tolist() == [1, 1]
    np.testing.assert_allclose(stopped.mean, whole.mean, atol=1e-10)
    np.testing.assert_allclose(stopped.covariance, whole.covariance, rtol=1e-7)


def test_what_cannot_be():
    with pytest.raises(ValueError, match="noise_density"):
        SaltationFilter(DROP, noise_density=np.eye(3))
    one = SaltationFilter(DROP, params=[30.0, NO_STOP], max_steps=1)
    with pytest.raises(ValueError, match="max_steps"):
        one.predict(START, 1.0)


@pytest.mark.parametrize("share", [0.5, 0.95])
def test_the_limit_is_the_quantile_of_chi_squared(share):
    for n in (2, 12):
        exact = chi2.ppf(share, n)
        assert confidence_limit(n, share=share) == pytest.approx(exact, rel=0.015)


def test_a_prediction_of_the_past_is_refused():
    one = SaltationFilter(DROP, params=[30.0, NO_STOP])
    with pytest.raises(ValueError, match=r"t: expected a time from 0 on, found -0\.1"):
        one.predict(START, -0.1)
    assert one.predict(START, 0.0).t == 0.0
