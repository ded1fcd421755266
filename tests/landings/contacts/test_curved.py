"""Common errors of feet whose swing ends with a jerk, beside feet that fall freely."""

import numpy as np

from hopdata.landings.contacts import kink_law
from hopdata.landings.contacts.descents import Transitions
from hopdata.landings.contacts.timing import find_contacts

RATE_HZ = 250.0
NOISE_M = 3e-4
PERIOD_S = 0.55
FALL_S = 0.2
GRAVITY_M_S2 = 9.80665
JERK_M_S3 = 250.0


def feet(seed, *, speed_m_s, jerk_m_s3, landings=60):
    """Return times, heights of two feet, their contacts and the transitions."""
    rng = np.random.default_rng(seed)
    time = np.arange(int((landings + 2) * PERIOD_S * RATE_HZ)) / RATE_HZ
    usual = PERIOD_S * (np.arange(landings) + 1)
    contacts = usual[:, None] + rng.normal(0, 0.006, (landings, 2))
    heights = rng.normal(0, NOISE_M, (len(time), 2))
    for foot, own in enumerate(contacts.T):
        for touch_s in own:
            since = time - touch_s
            falls = (since < 0) & (since >= -FALL_S)
            s = since[falls]
            height = -speed_m_s * s - GRAVITY_M_S2 * s**2 / 2 + jerk_m_s3 * s**3 / 6
            heights[falls, foot] += np.maximum(height, 0.0)
    frame_s = np.full(landings, 1 / RATE_HZ)
    begin_s = contacts.min(axis=1) - 0.05
    transitions = Transitions(begin_s, contacts.max(axis=1) + 0.02, frame_s, frame_s)
    return time, heights, contacts, transitions


def errors_and_common(jerk_m_s3):
    time, heights, truth, transitions = feet(7, speed_m_s=1.3, jerk_m_s3=jerk_m_s3)
    found = find_contacts(time, heights, transitions, down_height_m=0.015)
    return np.nanmean(found.instant - truth, axis=0), found.common


def without_curves(monkeypatch, jerk_m_s3):
    with monkeypatch.context() as patch:
        patch.setattr(kink_law, "curved_errors", lambda *_: np.zeros((1, 2)))
        return errors_and_common(jerk_m_s3)


def test_a_jerk_is_in_the_common_error(monkeypatch):
    mean_s, common_s = errors_and_common(JERK_M_S3)
    same_s, before_s = without_curves(monkeypatch, JERK_M_S3)
    np.testing.assert_array_equal(mean_s, same_s)
    assert (np.abs(same_s) > 2 * before_s).all()
    assert (np.abs(mean_s) < 2 * common_s).all()


def test_a_ballistic_foot_keeps_its_common_error(monkeypatch):
    _, common_s = errors_and_common(0.0)
    _, before_s = without_curves(monkeypatch, 0.0)
    np.testing.assert_allclose(common_s, before_s, rtol=0.05)
