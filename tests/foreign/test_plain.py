"""Plain values arrive as they were sent, and nothing else is received."""

import io
import json
from datetime import UTC, date, datetime, time
from pathlib import Path

import numpy as np
import pytest

from hopdata.foreign.budget import MOST_HEAD
from hopdata.foreign.plain import MARK, EndedError, WrongFrameError, receive, send

MOST = 10_000_000


def sent(value):
    stream = io.BytesIO()
    send(stream, value)
    return stream.getvalue()


def back(value):
    return receive(io.BytesIO(sent(value)), MOST)


@pytest.mark.parametrize(
    "value",
    [
        None,
        True,
        -3,
        10**30,
        0.1 + 0.2,
        float("inf"),
        "toe \N{GREEK SMALL LETTER MU}\udcff\n",
        b"\x00\xff",
        (1, [2.5, ("x",)], {}),
        {"a": 1, 2: (None,), None: {"list": [1], "array": 0}},
        datetime(2024, 2, 29, 12, 0, 0, 5, tzinfo=UTC),
        datetime(2024, 2, 29),
        date(2024, 2, 29),
        time(1, 2, 3),
        Path("a", "b c.trc"),
    ],
)
def test_values_arrive_as_they_were(value):
    found = back(value)
    assert found == value
    assert type(found) is type(value)


def test_numbers_of_numpy_become_those_of_python():
    found = back((np.float64(0.1), np.int32(3), np.bool_(True)))
    assert found == (0.1, 3, True)
    assert [type(one) for one in found] == [float, int, bool]


@pytest.mark.parametrize("dtype", ["f8", ">f4", "i2", "?", "c16", "u1"])
def test_arrays_keep_bytes_type_and_the_order_of_their_axes(dtype):
    numbers = np.random.default_rng(3).integers(0, 2, (6, 4, 3)).astype(dtype)
    for array in (
        numbers,
        np.asfortranarray(numbers),
        numbers.transpose(1, 0, 2),
        numbers.transpose(2, 0, 1),
        numbers[::2, ::-1],
        numbers[:0],
        numbers[0, 0, 0],
        np.broadcast_to(numbers[0], (6, 4, 3)),
    ):
        found = back({"x": np.asarray(array)})["x"]
        assert found.dtype == array.dtype
        assert found.shape == np.shape(array)
        np.testing.assert_array_equal(found, array)
        assert found.flags.writeable
    turned = numbers.transpose(1, 0, 2)
    assert back(turned).strides == turned.strides
    nan = np.array([np.nan, -0.0])
    assert back(nan).tobytes() == nan.tobytes()


def test_a_large_array_that_is_not_whole_is_sent_in_parts():
    wide = np.arange(6_000_000.0).reshape(3_000_000, 2)[:, :1]
    found = receive(io.BytesIO(sent(wide)), 24_000_000)
    np.testing.assert_array_equal(found, wide)


@pytest.mark.parametrize("value", [object(), {1}, np.array(["a"]), np.array([{}]), len])
def test_what_is_not_plain_is_not_sent(value):
    stream = io.BytesIO()
    with pytest.raises(TypeError, match="expected numbers"):
        send(stream, ["before", value])
    assert stream.getvalue() == b""


def test_too_many_levels_and_too_long_a_head_are_not_sent():
    deep = []
    for _ in range(100):
        deep = [deep]
    with pytest.raises(ValueError, match="at most 32 levels"):
        sent(deep)
    with pytest.raises(ValueError, match="bytes"):
        sent("x" * MOST_HEAD)


def frame(head, arrays=b""):
    if not isinstance(head, bytes):
        head = json.dumps(head).encode()
    return MARK + len(head).to_bytes(8, "little") + head + arrays


def head(tree=None, arrays=()):
    return {"value": tree, "arrays": list(arrays)}


@pytest.mark.parametrize(
    "content",
    [
        b"x" * 100,
        MARK + (1 << 40).to_bytes(8, "little") + b"x" * 100,
        frame(b"{"),
        frame(b"[" * 100_000),
        frame(b"1" * 10_000),
        frame([]),
        frame({"value": 1}),
        frame(head([1])),
        frame(head({"array": 0})),
        frame(head({"array": "x"}, [["<f8", [1]]]), bytes(8)),
        frame(head({"array": 0, "order": [0, 1]}, [["<f8", [1]]]), bytes(8)),
        frame(head({"list": 3})),
        frame(head({"tuple": [{"tuple": [{}]}]})),
        frame(head({"table": [[{"list": []}, 1]]})),
        frame(head({"datetime": "yesterday"})),
        frame(head({"pickle": "x"})),
        frame(head({"record": ["Event", [["label", "x"], ["time_s", 1.0]]]})),
        frame(head({"record": "Event"})),
        frame(head(None, [["O", [1]]])),
        frame(head(None, [["V8", [1]]])),
        frame(head(None, [["<f8", [-1]]])),
        frame(head(None, [["<f8", [1.5]]])),
        frame(head(None, [["<f8", [1] * 9]])),
        frame(head(None, [["<f8", [1 << 40]]])),
        frame(head(None, [["<f8", [1 << 20]]] * 2)),
    ],
)
def test_frames_that_claim_too_much_or_do_not_fit_are_refused(content):
    with pytest.raises(WrongFrameError):
        receive(io.BytesIO(content), MOST)


def test_a_head_as_deep_as_the_parser_goes_is_refused():
    tree = None
    for _ in range(200):
        tree = {"list": [tree]}
    with pytest.raises(WrongFrameError):
        receive(io.BytesIO(frame(head(tree))), MOST)


def test_every_end_before_the_end_is_told():
    whole = sent({"x": np.arange(5.0), "y": "text"})
    for n_bytes in range(len(whole)):
        with pytest.raises(EndedError):
            receive(io.BytesIO(whole[:n_bytes]), MOST)
    assert receive(io.BytesIO(whole + b"more"), MOST)["y"] == "text"
