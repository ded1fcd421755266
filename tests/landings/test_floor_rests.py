"""Feet at rest: which of their points count."""

import numpy as np

from hopdata.landings.floor_rests import LONG_RESTS, RestPoints, without_long_rests


def rests(lengths):
    """Return rests of one foot of these numbers of frames, at 100 Hz, 0.5 s apart."""
    time, places = [], []
    now = 0.0
    for place, length in enumerate(lengths):
        time.append(now + 0.01 * np.arange(length))
        places.append(np.full(length, float(place)))
        now = time[-1][-1] + 0.5
    time, place = np.concatenate(time), np.concatenate(places)
    points = np.column_stack([place, np.zeros((len(place), 2))])
    foot = np.zeros(len(place), dtype=np.int8)
    return RestPoints(points, foot, time, np.zeros(1), np.zeros(len(place), dtype=bool))


def test_a_place_stood_on_for_long_counts_as_ten_rests():
    found = without_long_rests(rests([20] * 30 + [5000] + [20] * 30))
    places, counts = np.unique(found.points[:, 0], return_counts=True)
    assert counts[places != 30].tolist() == [20] * 60
    assert counts[30] == LONG_RESTS * 20
    kept_s = found.time[found.points[:, 0] == 30]
    assert np.ptp(kept_s) > 49.0, "evenly over the whole rest"
    assert np.diff(kept_s).max() < 0.27


def test_usual_rests_stay_as_they_are():
    rest = rests([20, 35, 12, 150, 20])
    np.testing.assert_array_equal(without_long_rests(rest).time, rest.time)
    none = rest.take(np.zeros(len(rest.foot), dtype=bool))
    assert len(without_long_rests(none).foot) == 0
