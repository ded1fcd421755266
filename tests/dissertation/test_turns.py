"""Times by turns, and when two of them are on par."""

import time

import pytest

from hopdata.dissertation.turns import in_turn, on_par, timed


def spin(seconds):
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


def test_a_time_is_processor_time_of_this_thread():
    seconds, result = timed(lambda: time.sleep(0.05) or "slept")
    assert result == "slept"
    assert seconds < 0.04
    assert timed(lambda: spin(0.02))[0] == pytest.approx(0.02, abs=0.01)


def test_all_run_equally_often_and_by_turns():
    order = []
    runs = {name: (lambda name=name: order.append(name)) for name in "ab"}
    times = in_turn(runs, fewest=4, most=4)
    assert [len(times[name]) for name in "ab"] == [4, 4]
    assert order == ["a", "b"] * 5  # the first turn warms up


def test_a_slow_one_runs_as_often_as_it_must():
    assert len(in_turn({"slow": lambda: spin(0.1)}, fewest=1, most=9)["slow"]) <= 3


@pytest.mark.parametrize("ratio", [0.51, 0.707, 1.0, 1.414, 1.99])
def test_on_par(ratio):
    assert on_par(ratio)
    assert on_par(1 / ratio)


@pytest.mark.parametrize("ratio", [2.01, 10.0])
def test_not_on_par(ratio):
    assert not on_par(ratio)
    assert not on_par(1 / ratio)
