"""An event-selected hybrid system, as the user describes it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.signatures import FIELD, GUARDS, ON_EVENT
from hopdata.hybrid.workspace import Pool, Workspace


@dataclass(frozen=True)
class System:
    """A vector field with guards.

    Each guard k has a lock b_k, -1 or +1, kept in ``mode[k]``. It flips to +1 when the event
    function h_k rises through zero and to -1 when h_k falls through zero; field and handler see
    the locks, never the sign of h. ``mode[n_guards:]`` belongs to the scene.

    Parameters
    ----------
    field : Callback
        Vector field, declared by `hopdata.hybrid.field`.
    guards : Callback, optional
        Event functions and their rates, declared by `hopdata.hybrid.guards`.
    on_event : Callback, optional
        Handler, declared by `hopdata.hybrid.on_event`.
    n_states : int
        Length of the state.
    guard_names : tuple of str
        One name a guard, in the order in which `guards` fills them.
    directions : tuple of int, optional
        For each guard 0, +1 or -1: both crossings, only the rising or only the falling one are
        events. The lock follows the other crossing silently. By default 0.
    terminal : tuple of bool, optional
        Whether an event of the guard ends the integration. By default none does.
    n_extra_modes : int
        Number of the scene's own integers in the mode.
    """

    field: Callback
    guards: Callback | None = None
    on_event: Callback | None = None
    n_states: int = 1
    guard_names: tuple[str, ...] = ()
    directions: tuple[int, ...] | None = None
    terminal: tuple[bool, ...] | None = None
    n_extra_modes: int = 0

    def __post_init__(self) -> None:
        _check_callback("field", self.field, FIELD)
        if self.guards is not None or self.guard_names:
            _check_callback("guards", self.guards, GUARDS)
        if self.on_event is not None:
            _check_callback("on_event", self.on_event, ON_EVENT)
        if self.n_states < 1:
            raise ValueError(f"n_states: expected at least 1, found {self.n_states}")
        if self.guards is not None and not self.guard_names:
            raise ValueError("guard_names: expected one name for each guard, found none")
        for name, values in (("directions", self.directions), ("terminal", self.terminal)):
            if values is not None and len(values) != self.n_guards:
                raise ValueError(f"{name}: expected {self.n_guards} entries, found {len(values)}")
        if not set(self.directions or ()) <= {-1, 0, 1}:
            raise ValueError(f"directions: expected -1, 0 or +1, found {self.directions}")

    @property
    def n_guards(self) -> int:
        """Number of guards."""
        return len(self.guard_names)

    @property
    def n_modes(self) -> int:
        """Length of the mode: locks and the scene's own."""
        return self.n_guards + self.n_extra_modes

    @cached_property
    def rules(self) -> NDArray[np.int64]:
        """Directions and terminal flags, (2, n_guards)."""
        none = (0,) * self.n_guards
        return np.array([self.directions or none, self.terminal or none], dtype=np.int64)

    @cached_property
    def addresses(self) -> tuple[int, int, int]:
        """Addresses of the compiled field, guards and handler (0 where there is none)."""
        callbacks = (self.field, self.guards, self.on_event)
        field, guards, on_event = (0 if one is None else one.address for one in callbacks)
        return field, guards, on_event

    @cached_property
    def idle(self) -> Pool:
        """Workspaces of integrations that have ended, for the next."""
        return Pool()

    def take_workspace(self) -> Workspace:
        """Return memory for one integration, an idle one if there is any."""
        try:
            return self.idle.pop()
        except IndexError:
            return Workspace(
                self.addresses, self.rules, self.n_states, self.n_modes, self.guard_names
            )


def _check_callback(name: str, callback: Callback | None, signature: object) -> None:
    if not isinstance(callback, Callback) or callback.signature != signature:
        raise TypeError(f"{name}: expected a function declared by @{name}, found {callback!r}")
