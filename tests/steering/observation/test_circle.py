import numpy as np
import pytest

from hopdata.steering.observation.circle import algebraic_circle, arc_span, geometric_circle


def arc(span, n=400, noise=0.0, seed=1):
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    angle = np.linspace(0.3, 0.3 + span, n)
    points = 0.25 * np.column_stack([np.cos(angle), np.sin(angle)]) + [1.0, -2.0]
    return points + noise * rng.standard_normal(points.shape)


@pytest.mark.parametrize("fit", [algebraic_circle, geometric_circle])
@pytest.mark.parametrize("span", [0.5, 2.0, 6.2])
def test_exact_points_give_the_circle(fit, span):
    centre, radius = fit(arc(span))
    np.testing.assert_allclose(centre, [1.0, -2.0], atol=1e-9)
    assert radius == pytest.approx(0.25, abs=1e-9)


def test_on_a_short_arc_with_noise_the_algebraic_circle_is_too_small():
    radii = {
        fit: np.mean([fit(arc(0.8, noise=0.002, seed=s))[1] for s in range(60)])
        for fit in (algebraic_circle, geometric_circle)
    }
    assert radii[algebraic_circle] < 0.25 - 0.003
    assert abs(radii[geometric_circle] - 0.25) < 0.3 * (0.25 - radii[algebraic_circle])


@pytest.mark.parametrize("span", [0.2, 1.0, 3.0, 5.5])
def test_the_span_of_an_arc(span):
    assert arc_span(arc(span), np.array([1.0, -2.0])) == pytest.approx(span)
