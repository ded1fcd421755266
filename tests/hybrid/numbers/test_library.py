"""Each operation belongs to one group, which is compiled when it is called."""

from __future__ import annotations

import math
from collections import Counter
from ctypes import CFUNCTYPE, addressof, c_double, c_int64

import pytest

from hopdata.hybrid.numbers import library

SINE = library.GROUPS["waves"].index("sine")


def ends(*values):
    return (c_double * 4)(*values)


def addresses(*arrays):
    return [addressof(one) for one in arrays]


def test_each_operation_has_one_group():
    counts = Counter(name for names in library.GROUPS.values() for name in names)
    every = {*library.ONE, *library.TWO, *library.OF_ANYTHING, "table"}
    assert counts == dict.fromkeys(every, 1)


def test_a_group_whose_file_is_gone_is_compiled_when_called():
    called = CFUNCTYPE(None, *(5 * [c_int64]))(library._compiled("waves").address)
    x = ends(0.1, 0.2, 1.0, 1.0)
    at_once = ends(0.0, 0.0, 0.0, 0.0)
    late = ends(0.0, 0.0, 0.0, 0.0)
    called(SINE, *addresses(x, x), 0, *addresses(at_once))
    library.apply_late("waves", SINE, *addresses(x, x), 0, *addresses(late))
    assert bytes(late) == bytes(at_once)
    assert late[0] < math.sin(0.1) < math.sin(0.2) < late[1]


def test_nothing_is_known_where_a_group_cannot_be_compiled(monkeypatch):
    def fail(group):
        raise RuntimeError(group)

    monkeypatch.setattr(library, "_compiled", fail)
    x = ends(0.1, 0.2, 1.0, 1.0)
    result = ends(0.0, 0.0, 0.0, 0.0)
    with pytest.raises(RuntimeError, match="waves"):
        library.apply_late("waves", SINE, *addresses(x, x), 0, *addresses(result))
    assert all(map(math.isnan, result[:2]))
    assert result[2:] == [-math.inf, math.inf]
