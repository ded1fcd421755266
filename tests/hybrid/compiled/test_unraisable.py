"""Exceptions reach the thread that catches them; those of others the hook that was there."""

from __future__ import annotations

import sys
import threading
from types import SimpleNamespace

import pytest

from hopdata.hybrid.compiled.unraisable import Caught, current


@pytest.fixture
def passed_on(monkeypatch):
    seen: list = []
    monkeypatch.setattr(sys, "unraisablehook", seen.append)
    return seen


def unraisable(error, source="Numba's context"):
    return SimpleNamespace(exc_value=error, object=source)


def test_keeps_what_machine_code_raises(passed_on):
    error = ValueError()
    with Caught() as caught:
        sys.unraisablehook(unraisable(error))
    assert caught == [error]
    assert passed_on == []


def test_the_rest_goes_to_the_hook_that_was_there(passed_on):
    outside, destructor = unraisable(ValueError()), unraisable(ValueError(), object())
    with Caught() as caught:
        sys.unraisablehook(destructor)
    sys.unraisablehook(outside)
    assert caught == []
    assert passed_on == [destructor, outside]


def test_blocks_within_blocks(passed_on):
    with Caught() as outer:
        with Caught() as inner:
            sys.unraisablehook(unraisable(KeyError()))
            assert current() is inner
        assert current() is outer
    assert current() is None
    assert (len(outer), len(inner)) == (0, 1)


def test_each_thread_has_its_own(passed_on):
    with Caught() as caught:
        thread = threading.Thread(target=lambda: sys.unraisablehook(unraisable(KeyError())))
        thread.start()
        thread.join()
    assert caught == []
    assert len(passed_on) == 1


def test_a_hook_that_calls_the_one_before_it(monkeypatch):
    with Caught():
        ours = sys.unraisablehook
    ended = []
    monkeypatch.setattr(sys, "__unraisablehook__", ended.append)
    monkeypatch.setattr(sys, "unraisablehook", lambda one: ours(one))  # noqa: PLW0108
    with Caught():
        sys.unraisablehook(unraisable(KeyError(), object()))
    assert len(ended) == 1
