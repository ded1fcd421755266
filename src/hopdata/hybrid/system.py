"""The user's description of an event-selected hybrid system."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import Told, told_call
from hopdata.hybrid.arguments import check_flag, expect
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.constants import Constants
from hopdata.hybrid.compiled.kernel import SIGNATURES
from hopdata.hybrid.driver.loop import (
    compiled_first_order,
    compiled_run,
    driver_entry,
    many_entry,
)
from hopdata.hybrid.known_instants import instants_of
from hopdata.hybrid.methods.method import Scene
from hopdata.hybrid.methods.sparsity import Pattern, pattern_of
from hopdata.hybrid.methods.table import MethodTable
from hopdata.hybrid.methods.traced_pattern import find_sparsity
from hopdata.hybrid.numbers.derivatives import Derivatives, Exact, Functions
from hopdata.hybrid.numbers.guards import RangedGuards, guards_for_ranges
from hopdata.hybrid.numbers.switches import may_switch
from hopdata.hybrid.workspace import Pool, Workspace


@dataclass(frozen=True)
class System(Told):
    """A vector field with guards.

    Each guard k has a lock b_k, -1 or +1, kept in ``mode[k]``. The lock flips to +1
    when the event function h_k rises through zero and to -1 when h_k falls through
    zero. Field and handler see only the locks, never the sign of h. ``mode[n_guards:]``
    belongs to the scene.

    Parameters
    ----------
    field : Callback
        Vector field, declared by `hopdata.hybrid.field`.
    guards : Callback, optional
        Event functions and their rates, declared by `hopdata.hybrid.guards`.
    on_event : Callback, optional
        Handler, declared by `hopdata.hybrid.on_event`.
    undo : Callback, optional
        Handler for backward time, declared by `hopdata.hybrid.on_event`. It undoes the
        effect of `on_event` when the same guard is crossed from the other side.
    sparsity : matrix or (int, int), optional
        Where dy[i] may depend on y[j]: a matrix (n, n), SciPy's sparse or an array,
        that is not zero there, the bandwidths (lower, upper), what `find_sparsity`
        returns, or "auto": then it is found from the field's code. The Rosenbrock
        method needs memory for these derivatives only. `jacobian` fills them in sparse
        form (see `hopdata.hybrid.jacobian`).
    guard : Callback, optional
        Alternative to `guards`: one event function at a time, declared by
        `hopdata.hybrid.guard`.
    rate_bound : Callback, optional
        Only with `guard`: a bound on the rates of all event functions, declared by
        `hopdata.hybrid.rate_bound`. Guards far from their surfaces are then not
        evaluated. Event functions must not depend on the mode, and the modes in the log
        leave out the locks.
    jacobian : Callback, optional
        Derivative of the field, declared by `hopdata.hybrid.jacobian`. By default it
        comes from the field itself, by dual numbers.
    affine : Callback, optional
        Affine form of the field, declared by `hopdata.hybrid.affine`, if all modes are
        affine.
    n_states : int
        Length of the state.
    guard_names : tuple of str
        One name per guard, in the order in which `guards` fills them.
    directions : tuple of int, optional
        For each guard 0, +1 or -1: both crossings, only the rising or only the falling
        crossing is an event. The lock follows other crossings silently. By default 0.
    terminal : tuple of bool or int, optional
        For each guard, whether its event ends the integration, or which one: 2 means
        the second. By default no event does.
    n_extra_modes : int
        Number of the scene's own integers in the mode.
    n_memory : int
        Number of floats that follow the caller's in `params` and belong to one
        integration. The handler may change them, so the field need not sum over all
        contacts again.
    sliding : tuple of str, optional
        Names of guards along which the solution slides where the fields on both sides
        point at the surface. By default this ends the integration with a status.
    together : Callback, optional
        Law for instants at which several events are due, declared by
        `hopdata.hybrid.together`. By default they are processed in order, by
        `on_event`.
    on_zeno : str
        What happens where the events of a guard that may slide pile up: "stop" ends the
        integration with a status, "rest" lets the state go on with the guard at rest.
    tstops : array_like, Every, list or callable, optional
        Instants at which the field, or a derivative of it, jumps: times,
        `hopdata.hybrid.every` for periodic ones, or a list of both; or a function of
        the parameters that returns them. A step ends at each, and the next one begins
        anew.
    find_tstops : bool
        Whether instants at which the field's own code compares the time, or jumps in
        it, are found without being declared.
    """

    field: Callback
    guards: Callback | None = None
    on_event: Callback | None = None
    guard: Callback | None = None
    rate_bound: Callback | None = None
    jacobian: Callback | None = None
    affine: Callback | None = None
    n_states: int = 1
    guard_names: tuple[str, ...] = ()
    directions: tuple[int, ...] | None = None
    terminal: tuple[int, ...] | None = None
    n_extra_modes: int = 0
    n_memory: int = 0
    undo: Callback | None = None
    sparsity: Any = None
    sliding: tuple[str, ...] = ()
    together: Callback | None = None
    on_zeno: str = "stop"
    tstops: Any = None
    find_tstops: bool = True

    def __post_init__(self) -> None:
        self._declare_plain_functions()
        listed = isinstance(self.guard_names, tuple | list)
        expect(
            listed, "guard_names", "a name for each guard, in a tuple", self.guard_names
        )
        self._check_callbacks()
        self._check_guards()
        for name, least in (("n_states", 1), ("n_extra_modes", 0), ("n_memory", 0)):
            found = getattr(self, name)
            fits = isinstance(found, int | np.integer) and found >= least
            expect(fits, name, f"a whole number, at least {least}", repr(found))
        pattern: Pattern | None
        if isinstance(self.sparsity, str) and self.sparsity == "auto":
            pattern = find_sparsity(self.field, self.n_states, n_modes=self.n_modes)
        else:
            pattern = pattern_of(self.sparsity, int(self.n_states))
        object.__setattr__(self, "sparsity", pattern)
        self._check_entry_for_each_guard("directions", self.directions)
        self._check_entry_for_each_guard("terminal", self.terminal)
        known = set(self.directions or ()) <= {-1, 0, 1}
        expect(known, "directions", "-1, 0 or +1", self.directions)
        self._check_sliding()
        check_flag("find_tstops", self.find_tstops)
        if not callable(self.tstops):
            instants_of(self, None, ())
        counts = all(
            one in (True, False) or int(one) == one > 0 for one in self.terminal or ()
        )
        expect(counts, "terminal", "booleans or counts", self.terminal)
        states = self.n_states
        guards = self.n_guards
        if self.guards is not None:
            made = partial(_exact_rates, n_states=states, n_guards=guards)
            object.__setattr__(self, "guards", self.guards.with_exact_rates(made))
        for one in self.callbacks:
            one.check_lengths(
                y=states, dy=states, b=states, h=guards, hdot=guards, mode=self.n_modes
            )

    def _declare_plain_functions(self) -> None:
        """Declare functions that are given without their decorators."""
        for name in (*SIGNATURES, "undo"):
            given = getattr(self, name)
            if callable(given) and not isinstance(given, Callback):
                kind = "on_event" if name == "undo" else name
                made = Callback(given, SIGNATURES[kind])
                object.__setattr__(self, name, made)

    def _check_callbacks(self) -> None:
        needs_guards = bool(self.guard_names) and self.guard is None
        for name in SIGNATURES:
            needed = name == "field" or (name == "guards" and needs_guards)
            if needed or getattr(self, name) is not None:
                _check_callback(name, getattr(self, name))
        if self.undo is not None:
            _check_callback("on_event", self.undo)

    def _check_sliding(self) -> None:
        listed = isinstance(self.sliding, tuple | list)
        expect(listed, "sliding", "names of guards, in a tuple", repr(self.sliding))
        known = set(self.sliding) <= set(self.guard_names)
        expect(known, "sliding", f"guards among {self.guard_names}", self.sliding)
        differ = len(set(self.sliding)) == len(self.sliding)
        expect(differ, "sliding", "different guards", self.sliding)
        together = not self.sliding or self.guard is None
        expect(together, "sliding", "guards declared together, by @guards", "@guard")
        together = self.together is None or self.guard is None
        expect(together, "together", "guards declared together, by @guards", "@guard")
        known = self.on_zeno in ("stop", "rest")
        expect(known, "on_zeno", "'stop' or 'rest'", repr(self.on_zeno))
        rests = self.on_zeno == "stop" or bool(self.sliding)
        expect(rests, "on_zeno", "guards in sliding=... that come to rest", "none")
        bounces = self.on_zeno == "stop" or self.on_event is not None
        expect(bounces, "on_zeno", "a handler, on_event, with 'rest'", "none")
        for name in self.sliding:
            if self.directions is None:
                continue
            only_one = self.directions[self.guard_names.index(name)]
            wanted = f"0 for {name!r}, which may slide"
            expect(not only_one, "directions", wanted, self.directions)

    def _check_entry_for_each_guard(self, name: str, values: Any) -> None:
        if values is None:
            return
        listed = isinstance(values, tuple | list)
        expect(listed, name, "one entry for each guard", repr(values))
        fits = len(values) == self.n_guards
        expect(fits, name, f"{self.n_guards} entries", len(values))

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what pickle stores: the description, nothing that is made from it."""
        described = {one.name: getattr(self, one.name) for one in fields(self)}
        return _described, (type(self), described)

    def check_params_length(self, count: int) -> None:
        """Raise ValueError if a function uses an element of `params` beyond `count`."""
        if count < self.n_params:
            for one in self.callbacks:
                one.check_lengths(params=count)

    def _check_guards(self) -> None:
        one_way = self.guards is None or self.guard is None
        expect(one_way, "guards, guard", "one of them", "both")
        suits = self.rate_bound is None or self.guard is not None
        wanted = "guards declared one by one, by @guard"
        expect(suits, "rate_bound", wanted, "@guards")
        names = self.guard_names
        expect(len(set(names)) == len(names), "guard_names", "different names", names)
        named = names or (self.guards or self.guard) is None
        expect(named, "guard_names", "one name for each guard", names)

    @property
    def n_guards(self) -> int:
        """Number of guards."""
        return len(self.guard_names)

    @property
    def n_modes(self) -> int:
        """Length of the mode: the locks and the scene's own integers."""
        return self.n_guards + self.n_extra_modes

    @cached_property
    def way(self) -> float:
        """Direction of time: -1 in a system derived to run backward."""
        return 1.0

    @property
    def shown_guard_names(self) -> tuple[str, ...]:
        """Names of the guards that are the user's."""
        if self.slides is None:
            return self.guard_names
        return self.guard_names[self.slides.count :]

    @cached_property
    def by_law(self) -> bool:
        """Whether the handler of a derived system takes several guards at once."""
        return False

    @cached_property
    def rests(self) -> tuple[int, ...]:
        """Guards that come to rest where their events pile up, in a derived system."""
        return ()

    @property
    def is_plain(self) -> bool:
        """Whether the driver takes it as it is, without a derived system."""
        return not self.sliding and self.together is None

    @cached_property
    def has_instants(self) -> bool:
        """Whether instants are declared, or sought in the field's code."""
        if self.tstops is not None:
            return True
        return bool(self.find_tstops) and may_switch(self.field)

    @cached_property
    def takes_instants(self) -> bool:
        """Whether the driver looks at known instants, in a derived system."""
        return False

    @cached_property
    def switches(self) -> RangedGuards:
        """Code of the field for ranges, to find its jumps, in a derived system."""
        return RangedGuards()

    @cached_property
    def unsought(self) -> str:
        """Why the field's instants are not sought, in a derived system that asks."""
        return ""

    @cached_property
    def slides(self) -> Any:
        """How a system derived to slide shows what the user knows; None in others."""
        return None

    @cached_property
    def n_shown(self) -> int:
        """Number of states that are the user's."""
        return self.n_states

    @cached_property
    def rules(self) -> NDArray[np.int64]:
        """What the driver knows of each guard, (6, n_guards): see `layout`."""
        none = (0,) * self.n_guards
        directions = self.directions or none
        terminal = self.terminal or none
        ways = (self.way,) * self.n_guards
        by_law = (int(self.by_law),) * self.n_guards
        rests = [int(k in self.rests) for k in range(self.n_guards)]
        leaves_out = (int(self.branches.leaves_out),) * self.n_guards
        rows = [directions, terminal, ways, by_law, rests, leaves_out]
        return np.array(rows, dtype=np.int64)

    @property
    def callbacks(self) -> tuple[Callback, ...]:
        """The callbacks that are given."""
        given = (getattr(self, name) for name in SIGNATURES)
        return tuple(one for one in given if one is not None)

    @cached_property
    def constants(self) -> Constants:
        """What its functions' machine code is made from, besides their own text."""
        return Constants().joined(one.constants for one in self._all_callbacks)

    @property
    def _all_callbacks(self) -> tuple[Callback, ...]:
        if self.undo is None:
            return self.callbacks
        return (*self.callbacks, self.undo)

    def current(self) -> System:
        """Return the system as globals and closures of its functions are now.

        This is the system itself or, where one of them has changed since it was
        compiled, one with the same functions that is compiled anew.
        """
        latest: System = self.__dict__.get("_latest", self)
        if latest.constants.are_current():
            return latest
        anew = {}
        for name in (*SIGNATURES, "undo"):
            if getattr(self, name) is not None:
                anew[name] = getattr(latest, name).anew()
        fresh = replace(latest, **anew)
        # Remembers them now, and compiles the functions that are called.
        _ = fresh.constants
        vars(self)["_latest"] = fresh
        return fresh

    @cached_property
    def n_params(self) -> int:
        """Smallest number of parameters that the functions' code requires."""
        return max(one.n_params for one in self.callbacks)

    @cached_property
    def addresses(self) -> tuple[int, ...]:
        """Addresses of the compiled callbacks (0 if absent), and of the driver."""
        callbacks = (
            self.field,
            self.guards,
            self.guard,
            self.rate_bound,
            self.on_event,
        )
        addresses = [0 if one is None else one.address for one in callbacks]
        return (*addresses, compiled_run().address)

    @cached_property
    def branches(self) -> RangedGuards:
        """Code of the guards for ranges, by which the driver proves where they flip."""
        return guards_for_ranges(self.guards or self.guard, self.n_guards)

    @cached_property
    def derivatives(self) -> Derivatives:
        """Derivatives of its functions, by dual numbers; compiled when asked for."""
        functions = Functions(
            field=self.field,
            guards=self.guards or self.guard,
            handler=self.on_event,
            n_states=self.n_states,
            n_guards=self.n_guards,
            n_modes=self.n_modes,
        )
        return Derivatives(functions)

    @property
    def exact(self) -> Exact:
        """Exact derivatives at one place, of its functions as globals are now."""
        return self.current()._exact

    @cached_property
    def _exact(self) -> Exact:
        return Exact(self.derivatives, self.n_guards)

    @cached_property
    def made(self) -> dict[Any, Any]:
        """Cache of objects made for this system, keyed by their kind and choices.

        It holds method tables, machine code of the functions for many systems at a time
        (see `lanes.batch`), and systems derived from this one (see `hybrid.derived`).
        """
        return {}

    def methods(self, choice: str, jacobian: bool) -> MethodTable:
        """Return the table of methods among which the driver may choose."""
        key = MethodTable, str(choice), bool(jacobian)
        if key not in self.made:
            guards = self.guards or self.guard
            scene = Scene(
                self.field,
                self.n_states,
                self.jacobian,
                self.affine,
                guards,
                self.sparsity,
            )
            self.made[key] = MethodTable(choice, scene, jacobian)
        table: MethodTable = self.made[key]
        return table

    def compile(self, method: str = "auto", *, jacobian: bool = False) -> None:
        """Compile everything that `solve` and `solve_batch` may need for this system.

        Otherwise each part is compiled on first use, and the steps of explicit methods
        only after some millions of steps. Results are the same. Compilation takes some
        seconds, and less in later processes because the code is cached.

        Parameters
        ----------
        method, jacobian
            Values that will be passed to `solve`.

        Raises
        ------
        ValueError
            If no method has this name, or if it does not suit the system.
        """
        driver_entry()
        many_entry()
        if check_flag("jacobian", jacobian):
            compiled_first_order()
        latest = self.current()
        methods = latest.methods(method, jacobian)
        methods.compile_all()
        if jacobian:
            latest.derivatives.told(by_field=methods.by_field)
        latest.idle.append(latest.take_workspace())

    @cached_property
    def idle(self) -> Pool:
        """Workspaces of finished integrations, for reuse."""
        return Pool()

    def take_workspace(self) -> Workspace:
        """Return a workspace for one integration, an idle one if available."""
        try:
            return self.idle.pop()
        except IndexError:
            return Workspace(self)


def _exact_rates(values: Any, n_states: int, n_guards: int) -> Any:
    """Return guards with rates from those that fill `h`, by dual numbers."""
    from hopdata.hybrid.numbers.derivatives import rates_of

    return rates_of(values, n_states, n_guards)


def _described(kind: type[System], description: dict[str, Any]) -> System:
    """Return the system of a description; pickle calls this."""
    return kind(**description)


System.__init__ = told_call(System.__init__)  # type: ignore[method-assign]


def _check_callback(name: str, callback: Callback | None) -> None:
    fits = isinstance(callback, Callback) and callback.signature.name == name
    expect(fits, name, f"a function declared by @{name}", callback)
