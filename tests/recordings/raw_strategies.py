"""Recordings of any shape that a file can hold, for property tests of writers and readers."""

from datetime import datetime

import numpy as np
from hypothesis import strategies as st

from hopdata.recording import Event
from hopdata.recordings.raw import RawRecording

NAMES = st.text(
    st.characters(
        min_codepoint=33, max_codepoint=0x2FFF, categories=("L", "N", "P", "S")
    ),
    min_size=1,
    max_size=12,
)


@st.composite
def raw_recordings(draw, *, largest=5000.0, unit="mm", stated_up=("", "x", "y", "z")):
    """Draw a recording on its time grid, with some markers unseen and none at the origin."""
    n_frames, n_markers = draw(st.integers(2, 30)), draw(st.integers(1, 6))
    rate = float(draw(st.sampled_from([50, 100, 150, 240, 300, 1000, 2000])))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    positions = rng.uniform(-largest, largest, (n_frames, n_markers, 3))
    positions[0] = largest / 2  # the first frame is seen
    positions[rng.random((n_frames, n_markers)) < draw(st.sampled_from([0, 0.3]))] = (
        np.nan
    )
    positions[0, 0] = largest / 3
    names = draw(st.lists(NAMES, min_size=n_markers, max_size=n_markers, unique=True))
    first = draw(st.sampled_from([0, 1, 777, 70_000]))
    time = (first + np.arange(n_frames)) / rate
    span = st.floats(float(time[0]), float(time[-1]))
    events = draw(st.lists(st.builds(Event, NAMES, span), max_size=4))
    return RawRecording(
        tuple(names),
        time,
        positions,
        rate,
        unit,
        events=tuple(events),
        stated_up=draw(st.sampled_from(stated_up)),
        started=draw(st.sampled_from([None, datetime(2021, 1, 1, 12, 0, 0, 250_000)])),
    )


def assert_same(again, raw, *, atol, time_atol=1e-9, event_atol=1e-9):
    """Assert that what was read equals what was written."""
    assert again.markers == raw.markers
    assert again.rate_hz == raw.rate_hz
    np.testing.assert_array_equal(np.isnan(again.positions), np.isnan(raw.positions))
    np.testing.assert_allclose(again.positions, raw.positions, rtol=0, atol=atol)
    np.testing.assert_allclose(again.time, raw.time, rtol=0, atol=time_atol)
    assert [e.label for e in again.events] == [e.label for e in raw.events]
    np.testing.assert_allclose(
        [e.time_s for e in again.events],
        [e.time_s for e in raw.events],
        rtol=0,
        atol=event_atol,
    )
