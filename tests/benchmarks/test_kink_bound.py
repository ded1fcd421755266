"""The Cramer-Rao bound of a contact instant."""

import numpy as np
import pytest
from contact_instants import kink_bound, mean_kink_bound

COMMON = {"rate_hz": 100.0, "noise_m": 6e-4, "velocity_m_s": -1.0}


def ms(**options):
    return 1e3 * mean_kink_bound(**(COMMON | {"windows_s": (0.08, 0.05)} | options))


@pytest.mark.parametrize(
    ("windows_s", "known", "expected"),
    [((0.08, 0.06), True, 0.49), ((0.06, 0.06), False, 0.84)],
)
def test_the_bounds_of_the_first_measurements(windows_s, known, expected):
    assert ms(windows_s=windows_s, known_gravity=known) == pytest.approx(
        expected, abs=0.005
    )


def test_an_instant_between_known_lines():
    """With many frames, the kink of two lines is known to sigma / v (4 / n + 4 / n)^(1/2)."""
    s = np.linspace(-1, 1, 200_001)
    frames = (len(s) - 1) / 2
    bound = kink_bound(s, noise_m=1e-3, velocity_m_s=-2.0, known_gravity=True)
    assert bound == pytest.approx(1e-3 / 2 * np.sqrt(4 / frames + 1 / frames), rel=1e-3)


def test_less_is_known_with_more_unknown_and_with_fewer_frames():
    assert ms(known_gravity=True) < ms(known_gravity=False)
    for known in (True, False):
        assert ms(known_gravity=known) < ms(known_gravity=known, missing_frames=3)
        assert ms(known_gravity=known, windows_s=(0.1, 0.1)) < ms(known_gravity=known)


def test_softness_and_creep_hide_the_instant_a_little():
    soft = ms(known_gravity=True, compliance_s=0.005)
    assert ms(known_gravity=True) < soft < 1.2 * ms(known_gravity=True)
    assert ms(known_gravity=True, creep_m_s=-0.02) == pytest.approx(
        ms(known_gravity=True) / 0.98, rel=1e-6
    )


def test_two_frames_of_flight_fix_no_curvature():
    s = np.array([-0.02, -0.01, 0.0, 0.01, 0.02])
    options = {"noise_m": 6e-4, "velocity_m_s": -1.0}
    assert kink_bound(s, known_gravity=False, **options) == np.inf
    assert np.isfinite(kink_bound(s, known_gravity=True, **options))


def test_it_is_the_inverse_of_the_information():
    """Compare with differences of the model itself."""
    s = np.arange(-8, 6) / 100 + 0.003
    truth = np.array([0.0, 0.1, -1.0, -9.80665])

    def height(parameters):
        tau, c, b, a = parameters
        u = s - tau
        after = c + b * 0.005 * (1 - np.exp(-u / 0.005)) - 0.02 * u
        return np.where(s < 0, c + b * u + a * u**2 / 2, after)

    steps = 1e-6 * np.eye(4)
    jacobian = np.column_stack(
        [(height(truth + h) - height(truth - h)) / 2e-6 for h in steps]
    )
    expected = 6e-4 * np.sqrt(np.linalg.inv(jacobian.T @ jacobian)[0, 0])
    found = kink_bound(
        s,
        noise_m=6e-4,
        velocity_m_s=-1.0,
        known_gravity=False,
        compliance_s=0.005,
        creep_m_s=-0.02,
    )
    assert found == pytest.approx(expected, rel=1e-6)
