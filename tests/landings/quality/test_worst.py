"""The landings to look at: one of each reason, then the least sure."""

import numpy as np
import pandas as pd
import pytest
from section_fakes import hopper

from hopdata.landings.quality.worst import MARGIN_S, OPEN_S, landing_samples, worst_landings


def table(reasons, errors, probabilities):
    n = len(reasons)
    return pd.DataFrame(
        {
            "recording": "fake",
            "index": np.arange(n),
            "t_pre_s": 1.0 + np.arange(n),
            "t_post_s": 1.1 + np.arange(n),
            "contact_foot1_s": 1.05 + np.arange(n),
            "se_foot1_s": errors,
            "probability": probabilities,
            "excluded": [bool(reason) for reason in reasons],
            "reason": reasons,
        }
    )


def test_one_of_each_reason_then_the_least_sure_in_turn():
    made = table(
        ["late", "", "late", "", "poor", "", "late", ""],
        [9, 1, 9, 4, 9, 2, 9, 3],
        [0, 0.7, 0, 0.9, 0, 0.6, 0, 1.0],
    )
    found = worst_landings(made, 6)
    assert list(found["landing"]) == [1, 2, 3, 4, 5, 6]
    assert found["why"][0] == "excluded (3 times): late"
    assert found["why"][1] == "excluded (once): poor"
    assert list(found["index"][2:]) == [3, 5, 7, 1]  # error 4, p 0.6, error 3, p 0.7
    assert list(found["why"][2:4]) == ["least sure contact", "most doubtful order"]


@pytest.mark.parametrize("number", [1, 2, 50])
def test_never_more_than_asked_for_nor_twice_the_same(number):
    made = table(["a", "b", "c", "", ""], [1, 2, 3, 4, 5], [1.0] * 5)
    found = worst_landings(made, number)
    assert len(found) == min(number, 5)
    assert found["index"].is_unique


def test_no_touchdown_at_all():
    empty = table([], [], [])
    found = worst_landings(empty, 12)
    assert found.empty
    assert landing_samples([], found).empty


def test_samples_are_the_recording_around_the_landing():
    recording = hopper(np.random.default_rng(0), hops=20).recording
    name, feet = recording.name, recording.names("foot")
    made = table(["", "never down"], [1.0, np.nan], [1.0, 0.0]).assign(recording=name)
    made.loc[1, "t_post_s"] = np.nan
    samples = landing_samples([recording], worst_landings(made, 2))
    for landing, end in ((2, 0.1), (1, OPEN_S)):
        own = samples[samples["landing"] == landing]
        assert set(own["foot"]) == set(feet)
        assert own["time_s"].min() == pytest.approx(-MARGIN_S, abs=0.011)
        assert own["time_s"].max() == pytest.approx(end + MARGIN_S, abs=0.011)
    first = samples[(samples["landing"] == 2) & (samples["foot"] == feet[1])]
    frames = np.searchsorted(recording.time, 1.0 + first["time_s"].to_numpy() - 1e-9)
    assert np.array_equal(first["height_m"], recording.feet[frames, 1, 2])
