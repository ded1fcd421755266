"""Onsets of a force: instants of known crossings, rattles, dips, gaps, thresholds."""

import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.landings.force_contacts import contact_times_of, threshold_of
from hopdata.recordings.external import Column, ForceSignal

RATE_HZ = 500.0
OPTIONS = {
    "threshold_n": None,
    "threshold_share": 0.05,
    "body_weight_n": None,
    "other_feet_above_m": None,
}


def signal(force, **options):
    time = np.arange(len(force)) / RATE_HZ
    column = Column("Fz", ("heel", "toe"))
    unit = options.pop("unit", "N")
    return ForceSignal(column, time, np.asarray(force, float), unit, {**OPTIONS, **options})


def stances(onsets, *, n=2000, rise_n_s=20_000.0, load_n=800.0, length_s=0.2):
    """Ramps from exactly the onsets on, held and dropped."""
    time = np.arange(n) / RATE_HZ
    force = np.zeros(n)
    for onset in onsets:
        stance = (time > onset) & (time < onset + length_s)
        force[stance] = np.minimum(rise_n_s * (time[stance] - onset), load_n)
    return force


def instants(force_signal, threshold):
    return contact_times_of(force_signal, threshold=threshold).instant


ONSETS = np.array([0.3137, 1.1002, 1.9999, 3.0503])


def test_a_ramp_crosses_the_threshold_when_it_must():
    found = instants(signal(stances(ONSETS)), 100.0)
    np.testing.assert_allclose(found, ONSETS + 100 / 20_000, atol=1e-12)


def test_rattles_and_dips_make_no_contacts():
    force = stances(ONSETS)
    force[40:44] = 150.0  # a rattle of the plate
    force[(np.abs(np.arange(2000) / RATE_HZ - 1.2)) < 0.004] = 0.0  # a dip in stance
    found = instants(signal(force), 50.0)
    np.testing.assert_allclose(found, ONSETS + 50 / 20_000, atol=1e-12)


def test_a_dip_during_the_rise_belongs_to_the_contact():
    force = stances(ONSETS)
    rise = np.flatnonzero(force > 100)[:1]
    force[rise + 1] = 0.0
    found = instants(signal(force), 50.0)
    np.testing.assert_allclose(found, ONSETS + 50 / 20_000, atol=1e-12)


def test_an_onset_beside_a_missing_sample_is_left_out():
    force = stances(ONSETS)
    first = int(np.flatnonzero(force > 0)[0])
    force[first - 1 : first + 2] = np.nan
    found = instants(signal(force), 100.0)
    np.testing.assert_allclose(found, ONSETS[1:] + 100 / 20_000, atol=1e-12)


def test_a_signal_that_begins_loaded_has_no_first_onset():
    force = stances([-0.1, 1.1002])
    np.testing.assert_allclose(instants(signal(force), 100.0), [1.1052])


def test_a_load_that_is_never_reached_is_told():
    with pytest.raises(AnalysisError, match=r"more than twice the threshold of 500 N.*800"):
        instants(signal(stances(ONSETS)), 500.0)
    with pytest.raises(AnalysisError, match="found at most 0"):
        instants(signal(np.zeros(100)), 20.0)


def test_thresholds():
    force = stances(ONSETS)
    assert threshold_of(signal(force, threshold_n=33.0)) == 33.0
    assert threshold_of(signal(force, body_weight_n=700.0)) == pytest.approx(35.0)
    assert threshold_of(signal(force)) == pytest.approx(0.05 * force.mean())
    assert threshold_of(signal(force / 700, unit="body_weight")) == 0.05


def test_contact_times_carry_column_span_and_other_feet():
    times = contact_times_of(signal(stances(ONSETS), threshold_n=100.0, other_feet_above_m=0.02))
    assert times.column.feet == ("heel", "toe")
    assert times.source == "forces"
    assert times.span_s == (0.0, pytest.approx(1999 / RATE_HZ))
    assert times.other_feet_above_m == 0.02
    np.testing.assert_allclose(times.instant, ONSETS + 0.005)
    higher = contact_times_of(signal(stances(ONSETS)), threshold=200.0)
    np.testing.assert_allclose(higher.instant, ONSETS + 0.01)
