"""The pattern of a field's Jacobian, from the field's own code.

The field is compiled for traces (see `numbers.traces`) and run once along every path
that its comparisons of states, time and mode allow. What a rate was made from, on any
path, is what it may depend on. So the pattern is never too small. It may be too large
where a dependence cancels, and where one cannot be told there is no pattern.
"""

from typing import Any

import numpy as np
from numba import cfunc, types
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import compiled_in_cache, function_digest, kept_njit
from hopdata.errors import ArgumentError
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.calls import caller
from hopdata.hybrid.compiled.declare import reason_and_advice
from hopdata.hybrid.compiled.digest import in_module_of, with_digest
from hopdata.hybrid.compiled.kernel import ENTRY, SIGNATURES
from hopdata.hybrid.compiled.memory import array_at
from hopdata.hybrid.methods.sparsity import Pattern
from hopdata.hybrid.numbers.answers import next_answers
from hopdata.hybrid.numbers.derivatives import own_digest

_INT = types.int64
NATIVE = types.void(*(6 * [_INT]))
call_traced = caller(NATIVE)

#: Most paths through a field's comparisons that are followed.
#: Unit: 1. Origin: chosen: eight comparisons of independent outcome.
MOST_PATHS = 256

#: Most derivatives of a rate, on average, for which a pattern is of use.
#: Unit: 1. Origin: chosen.
MOST_PER_ROW = 256

#: Numbers of the arena for each state, at first.
#: Unit: 1. Origin: chosen.
FIRST_ROOM = 128

#: Numbers of the arena for each state, at most.
#: Unit: 1. Origin: chosen: it takes 160 MB for 10,000 states.
MOST_ROOM = 2048

UNKNOWN = 4096  # more parameters than any field names one by one

# Inserted into `field_of_traces`.
N: int = 0
CALL: Any = None
ROWS = NUMBERS = CALL


def field_of_traces(
    moment: int, states: int, mode: int, n_modes: int, params: int, n_params: int
) -> None:
    """Evaluate the field; rows of rates follow those of the states."""
    row = 16  # bytes of a trace
    numbers = NUMBERS(params, n_params)
    rates = ROWS(states + N * row, N)
    CALL(ROWS(moment, 1)[0], ROWS(states, N), ROWS(mode, n_modes), numbers, rates)


def find_sparsity(
    field: Any, n_states: int, *, params: ArrayLike | None = None, n_modes: int = 0
) -> Pattern:
    """Return on which states each rate of a field depends, as the field's code tells.

    The code is run with numbers that remember from which states they were made, once
    along every path that its comparisons allow. So nothing that matters is missing,
    whatever the states, the time and the mode are.

    Parameters
    ----------
    field : callable
        The vector field, plain or declared by `hopdata.hybrid.field`.
    n_states : int
        Number of states.
    params : (p,) array, optional
        Parameters of the field, if they decide sizes, indices or branches. The pattern
        then holds for these. By default they may have any values.
    n_modes : int
        Number of modes: of guards, and the system's further ones.

    Returns
    -------
    Pattern
        For `System`'s `sparsity`.

    Raises
    ------
    ArgumentError
        If the code does not tell: if it does not compile, if the state, the time or the
        mode decides an index or the end of a loop, or if it branches too often.
    """
    if not isinstance(field, Callback):
        field = Callback(field, SIGNATURES["field"])
    known = None
    if params is not None:
        known = np.array(params, dtype=float).reshape(-1)
    return traced_pattern(field, int(n_states), int(n_modes), known)


def traced_pattern(
    field: Callback, n_states: int, n_modes: int, params: FloatArray | None = None
) -> Pattern:
    """Return the places of a field's Jacobian that may differ from zero.

    Parameters
    ----------
    field : Callback
        The vector field.
    n_states, n_modes : int
        Numbers of states and of modes. The mode may have any values.
    params : (p,) array, optional
        Parameters for which the pattern is wanted. Without them they may have any
        values.

    Raises
    ------
    ArgumentError
        If the field's code does not tell the pattern.
    """
    from hopdata.hybrid.numbers import traces

    if not field.compiled:
        raise _untold("it runs as plain Python")
    known = params is not None
    if params is None:
        taken = field.elements_of("params", UNKNOWN)
        if len(taken) == UNKNOWN:
            raise _untold(
                "it takes parameters by indices that its text does not show "
                "(find_sparsity with these parameters may help)"
            )
        params = np.zeros(max(taken, default=-1) + 1)
    names: dict[str, Any] = {
        "ROWS": array_at(traces.TRACE),
        "NUMBERS": array_at(types.float64 if known else traces.TRACE),
        "N": n_states,
        "CALL": field.dual,
    }
    try:
        function = with_digest(field_of_traces, **names)
        own = in_module_of(own_digest(), field)
        digest = f"{function_digest(function)}-{known}-{own}"

        def compile_it(cached: bool) -> Any:
            return cfunc(NATIVE, cache=cached and field.kept, **ENTRY)(function)

        code = compiled_in_cache(function, digest, compile_it)
    # Numba's own exceptions, and others raised within it.
    except Exception as error:
        raise _untold(reason_and_advice(error, field.users)[0]) from None
    return _Run(code.address, n_states, n_modes, params, known).pattern()


def _untold(reason: str) -> ArgumentError:
    return ArgumentError(
        f"sparsity: expected a field whose code tells on which states each rate "
        f"depends, found that {reason}; give the pattern as a matrix or as bandwidths"
    )


class _Run:
    """The runs of a field along all its paths."""

    def __init__(
        self, address: int, n: int, n_modes: int, params: FloatArray, known: bool
    ) -> None:
        self._address = address
        self._n = n
        self._n_modes = n_modes
        self._params = params
        self._known = known

    def pattern(self) -> Pattern:
        """Return the pattern of all paths."""
        from hopdata.hybrid.numbers import traces

        room = FIRST_ROOM
        answers = 0
        found = []
        for _ in range(MOST_PATHS):
            arena = self._along(answers, room)
            is_full = arena[traces.NEXT] + traces.NODE > arena[traces.SIZE]
            while is_full and room < MOST_ROOM:
                room *= 4
                arena = self._along(answers, room)
                is_full = arena[traces.NEXT] + traces.NODE > arena[traces.SIZE]
            if arena[traces.LOST] != 0:
                raise _untold(
                    "a state, the time or the mode decides an index, a loop, or more "
                    f"than {traces.N_ANSWERS} comparisons, or each rate depends on many"
                )
            found.append(self._entries(arena))
            opened = int(arena[traces.OPENED])
            answers = next_answers.py_func(answers, opened)
            if answers < 0:
                places = np.concatenate(found)
                return Pattern(
                    self._n,
                    places // self._n,
                    places % self._n,
                    is_proven=not self._known,
                )
        raise _untold(f"its comparisons have more than {MOST_PATHS} outcomes")

    def _along(self, answers: int, room: int) -> IntArray:
        """Return the arena after a run with these answers.

        The traces of states and rates are in `_rows` then.
        """
        from hopdata.hybrid.numbers import traces

        n = self._n
        size = traces.HEADER + (n + 1) * traces.NODE + room * (n + 16)
        arena: IntArray = np.zeros(size, dtype=np.int64)
        arena[traces.SIZE] = size
        arena[traces.ANSWERS] = answers
        # A leaf has the state's number as a negative one, which is no address. The last
        # leaf stands for what varies but is no state.
        leaves = arena[traces.HEADER :][: (n + 1) * traces.NODE].reshape(-1, 3)
        leaves[:, traces.LEFT] = -1 - np.arange(n + 1)
        leaves[:, traces.ARENA] = arena.ctypes.data
        arena[traces.NEXT] = traces.HEADER + (n + 1) * traces.NODE
        first = arena.ctypes.data + traces.BYTES * traces.HEADER
        nodes = first + traces.BYTES * traces.NODE * np.arange(n + 1)
        self._rows = _traced(np.ones(2 * n), np.append(nodes[:n], np.zeros(n, int)))
        moment = _traced(np.zeros(1), nodes[n:])
        mode = _traced(np.zeros(self._n_modes), np.full(self._n_modes, nodes[n]))
        params: Any = self._params
        if not self._known:
            params = _traced(params, np.full(len(params), nodes[n]))
        call_it(
            self._address,
            moment.ctypes.data,
            self._rows.ctypes.data,
            mode.ctypes.data,
            self._n_modes,
            params.ctypes.data,
            len(self._params),
        )
        return arena

    def _entries(self, arena: IntArray) -> IntArray:
        """Return the numbers row n + column of what the rates depend on."""
        found = np.empty(MOST_PER_ROW * (self._n + 4), dtype=np.int64)
        nodes = self._rows[self._n :, 1].copy()
        nodes[nodes != 0] -= arena.ctypes.data
        count = gather(arena, arena.ctypes.data, nodes, self._n, found)
        if count < 0:
            raise _untold(f"its rates depend on more than {MOST_PER_ROW} states each")
        return found[:count]


def _traced(values: FloatArray, nodes: IntArray) -> IntArray:
    """Return traces as rows of two numbers."""
    rows: IntArray = np.zeros((len(values), 2), dtype=np.int64)
    rows[:, 0] = values.view(np.int64)
    rows[:, 1] = nodes
    return rows


@kept_njit()
def call_it(
    address: int, moment: int, states: int, mode: int, n_modes: int, params: int,
    n_params: int,
) -> None:  # fmt: skip
    """Call the field's code for traces."""
    call_traced(address, moment, states, mode, n_modes, params, n_params)


@kept_njit()
def gather(
    arena: IntArray, start: int, nodes: IntArray, n: int, found: IntArray
) -> int:
    """Write row n + column for each leaf below the nodes; return their number, or -1.

    Nodes are given by their distance from the arena's start, in bytes.
    """
    count = 0
    seen = np.full(len(arena), -1, dtype=np.int32)
    waiting = [0]  # tells Numba the type of the list, and stays in it
    for i in range(n):
        if nodes[i] == 0:
            continue
        waiting.append(nodes[i] // 8)
        while len(waiting) > 1:
            place = waiting.pop()
            if seen[place] == i:
                continue
            seen[place] = i
            if arena[place] < 0:
                column = -1 - arena[place]
                if column < n:
                    if count == len(found):
                        return -1
                    found[count] = i * n + column
                    count += 1
                continue
            waiting.append((arena[place] - start) // 8)
            waiting.append((arena[place + 1] - start) // 8)
    return count
