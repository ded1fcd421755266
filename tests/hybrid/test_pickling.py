"""A system that is pickled, here and in another process."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from functools import partial

import numba
import numpy as np
import pytest
from hybrid_systems import ball, fall_field, rebound

from hopdata.errors import ArgumentError, NotPicklableError
from hopdata.hybrid import System, field, solve

MODEL = """
import numba
import numpy as np
from hopdata.hybrid import System, affine, field, guards, jacobian, on_event

k = 2.0
table = np.array([0.5, 1.5])

@numba.njit
def pull(y):
    return -k * y * table[1]

@field
def swing(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = pull(y[0]) + params[0]

def levels(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0], dy[0]

@on_event(compiled=False)
def count(t, y, mode, params, guard, direction):
    mode[1] += 1
    y[1] *= 0.99
    return 0

system = System(swing, guards(levels), count, n_states=2, guard_names=("zero",), n_extra_modes=1)
"""
READ = """
import pickle, sys
from hopdata.hybrid import solve
with open(sys.argv[1], "rb") as file:
    system = pickle.load(file)
solution = solve(system, (0, 9), [1.0, 0.0], params=[0.1])
print(solution.y.tobytes().hex(), solution.events.records.tobytes().hex())
import model
model.k = 5.0
with open(sys.argv[1], "rb") as file:
    pickle.load(file)
"""
MAIN = """
import multiprocessing
from hopdata.hybrid import System, field, solve

@field
def decay(t, y, mode, params, dy):
    dy[0] = -2.0 * y[0]

def end_of(system):
    return solve(system, (0, 1), [1.0]).y_end[0].hex()

if __name__ == "__main__":
    system = System(decay, n_states=1)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        print(pool.map(end_of, [system]) == [end_of(system)])
"""


def run(folder, script, *arguments):
    file = folder / "script.py"
    file.write_text(script)
    command = [sys.executable, str(file), *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, cwd=folder, check=False
    )


@pytest.fixture
def model(tmp_path, monkeypatch):
    (tmp_path / "model.py").write_text(MODEL)
    monkeypatch.syspath_prepend(str(tmp_path))
    import model

    yield model
    del sys.modules["model"]


def test_the_same_in_a_fresh_process_and_refused_where_a_constant_differs(
    model, tmp_path
):
    solution = solve(model.system, (0, 9), [1.0, 0.0], params=[0.1])
    assert len(solution.events) > 3
    (tmp_path / "pickled").write_bytes(pickle.dumps(model.system))
    fresh = run(tmp_path, READ, tmp_path / "pickled")
    expected = f"{solution.y.tobytes().hex()} {solution.events.records.tobytes().hex()}"
    assert fresh.stdout.strip() == expected, fresh.stderr[-500:]
    assert fresh.returncode == 1
    assert "ArgumentError: model.swing: expected k = 2.0" in fresh.stderr
    assert fresh.stderr.strip().endswith("found 5.0")


def test_a_system_of_a_script_reaches_its_workers(tmp_path):
    done = run(tmp_path, MAIN)
    assert done.stdout.strip() == "True", done.stderr[-500:]


@pytest.mark.parametrize(
    "duplicate", [lambda s: pickle.loads(pickle.dumps(s)), copy.deepcopy]
)
@pytest.mark.parametrize("solved_before", [False, True])
def test_a_system_in_the_same_process(duplicate, solved_before):
    options = {"params": (2.0, 0.0, 0.5)}
    system = ball(directions=(1,), terminal=(3,), undo=rebound)
    first = solve(system, (0, 9), [1.0, 0.0], **options) if solved_before else None
    again = duplicate(system)
    assert again == system
    assert again.field is fall_field
    assert len(again.idle) == 0
    solution = solve(again, (0, 9), [1.0, 0.0], **options)
    first = first or solve(system, (0, 9), [1.0, 0.0], **options)
    assert solution.t.tobytes() == first.t.tobytes()
    assert solution.status == first.status == 1


def plain(t, y, mode, params, dy):
    dy[0] = 1.0


@numba.njit
def jitted(t, y, mode, params, dy):
    dy[0] = 1.0


@field
def replaced(t, y, mode, params, dy):
    dy[0] = 1.0


@pytest.mark.parametrize("function", [plain, jitted])
def test_a_function_that_was_declared_elsewhere(function):
    system = System(field(function), n_states=1)
    again = pickle.loads(pickle.dumps(system))
    assert again.field.function is system.field.function
    assert solve(again, (0, 1), [0.0]).y_end == pytest.approx([1.0])


def local_field():
    @field
    def inside(t, y, mode, params, dy):
        dy[0] = 1.0

    return inside


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (
            local_field,
            r"field 'inside' \(.*test_pickling.py:\d+\).*inside another function",
        ),
        (lambda: field(lambda t, y, mode, params, dy: dy.fill(1.0)), "lambda"),  # noqa: ARG005
        (lambda: field(partial(plain), compiled=False), "cannot be pickled"),
    ],
)
def test_what_no_module_holds_is_refused(make, why):
    system = System(make(), n_states=1)
    with pytest.raises(NotPicklableError, match=why) as caught:
        pickle.dumps(system)
    assert isinstance(caught.value, pickle.PicklingError)
    assert "top level of a module" in str(caught.value)
    assert copy.deepcopy(system) == system


def test_a_name_that_stands_for_something_else_now(monkeypatch):
    pickled, system = pickle.dumps(replaced), System(replaced, n_states=1)
    monkeypatch.setitem(globals(), "replaced", field(plain))
    with pytest.raises(NotPicklableError, match=r"replaced is now another object"):
        pickle.dumps(system)
    monkeypatch.setitem(globals(), "replaced", 7)
    with pytest.raises(ArgumentError, match=r"replaced: expected a function .*found 7"):
        pickle.loads(pickled)


factor = 1.0
table = np.arange(2000.0)
gains = (1.0, (2.0, 3.0))
fixed = np.array([1.0])
fixed.flags.writeable = False


@field
def reading(t, y, mode, params, dy):
    dy[0] = factor * table[1000] * gains[0] * fixed[0]


@pytest.mark.parametrize("name", ["factor", "table", "gains", "fixed"])
def test_constants_must_be_those_of_the_other_process(monkeypatch, name):
    pickled = pickle.dumps(reading)
    assert pickle.loads(pickled) is reading
    other = table.copy()
    other[1000] += 1.0
    others = {
        "factor": 2.0, "table": other, "gains": (1.0, (2.0, 4.0)), "fixed": np.array([2.0]),
    }  # fmt: skip
    monkeypatch.setitem(globals(), name, others[name])
    shown = {"gains": r"gains\[1\]\[1\]"}.get(name, name)
    with pytest.raises(ArgumentError, match=rf"reading: expected {shown} = "):
        pickle.loads(pickled)
    assert pickle.loads(pickle.dumps(reading)) is reading


def test_a_constant_that_is_of_another_kind_there(monkeypatch):
    pickled = pickle.dumps(reading)
    monkeypatch.setitem(globals(), "factor", None)
    with pytest.raises(
        ArgumentError, match=r"expected factor = 1.0.*found .*no number"
    ):
        pickle.loads(pickled)
