"""The derived system, made from the templates of this room."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.constants import Constants
from hopdata.hybrid.compiled.digest import with_digest
from hopdata.hybrid.compiled.kernel import SIGNATURES, kernel_apart
from hopdata.hybrid.methods.method import put_in
from hopdata.hybrid.sliding.guards import (
    guards_template,
    rate_template,
    shares_template,
)
from hopdata.hybrid.sliding.handler import (
    begins_template,
    call_template,
    depends_template,
    handler_template,
    leave_template,
    no_handler,
    rates_template,
    release_template,
    terms_template,
)
from hopdata.hybrid.sliding.mix import (
    corners_template,
    differs_template,
    field_template,
    mix,
)
from hopdata.hybrid.sliding.reactions import (
    along_template,
    approach_template,
    mix_template,
    no_approach,
    no_rest,
    rest_template,
)
from hopdata.hybrid.sliding.records import Slides

# What takes the place of a template where no guard may rest; None: nothing.
WITHOUT_REST: dict[str, Any] = {
    "APPROACH": no_approach,
    "ALONG": None,
    "BENDS": None,
    "MIX": None,
    "REST": no_rest,
}

# Each may call those before it.
TEMPLATES = {
    "CORNERS": corners_template,
    "DIFFER": differs_template,
    "SLIDE": mix,
    "APPROACH": approach_template,
    "ALONG": along_template,
    "BENDS": rate_template,
    "MIX": mix_template,
    "SHARES": shares_template,
    "RATE": rate_template,
    "RATES": rates_template,
    "LOSES": depends_template,
    "TERMS": terms_template,
    "BEGINS": begins_template,
    "LEAVE": leave_template,
    "CALL": call_template,
    "RELEASE": release_template,
    "REST": rest_template,
}


class Mixed(Callback):
    """A function of the derived system, made from a template.

    Parameters
    ----------
    kind : str
        Kind of function, a key of `SIGNATURES`.
    template : callable
        The template.
    inner : Callback
        The user's function of this kind; the field where there is none.
    users : tuple of Callback
        All of the user's functions that it calls.
    **names : object
        What is inserted into the templates.
    """

    no_dual = "duals do not follow the mix of fields of a guard that slides"

    def __init__(
        self,
        kind: str,
        template: Callable[..., Any],
        inner: Callback,
        users: tuple[Callback, ...],
        **names: Any,
    ) -> None:
        super().__init__(with_digest(template, **names), SIGNATURES[kind])
        self.inner = inner
        self._users = users
        # Otherwise the code contains the address of a Python function.
        self.kept = self.compiled

    @cached_property
    def dispatcher(self) -> Any:
        """The function, callable from other code in Numba."""
        return put_in(self.function)

    @cached_property
    def ranged(self) -> Any:
        """Nothing: ranges know of no mix, so guards that may slide are sampled."""
        raise TypeError("ranges do not follow the mix of fields of a guard that slides")

    @cached_property
    def constants(self) -> Constants:
        """Nothing of its own: the user's system looks at the user's functions."""
        return Constants()

    @property
    def compiled(self) -> bool:
        """Whether the user's functions are compiled."""
        return all(one.compiled for one in self._users)

    @property
    def n_params(self) -> int:  # type: ignore[override]
        """Smallest number of parameters that the user's functions require."""
        return max(one.n_params for one in self._users)

    def check_lengths(self, **lengths: int) -> None:
        """Check nothing: the user's system has checked the user's functions."""


def insert_templates(names: dict[str, Any], *, rests: bool) -> None:
    """Add the functions made from the templates to the names.

    Without rest, its parts are left out, which halves the time of compilation.
    """
    for name, template in TEMPLATES.items():
        known = names
        if name == "BENDS":  # the rates of what APPROACH gives
            known = {**names, "SHARES": names["APPROACH"]}
        made = template
        if not rests:
            made = WITHOUT_REST.get(name, template)
        if made is not None:
            names[name] = kernel_apart(with_digest(made, **known))
        elif name == "MIX":
            names[name] = names["SLIDE"]


def sliding_system(system: Any) -> Any:
    """Return the derived system that slides along the guards declared for it."""
    if "sliding" in system.made:
        return system.made["sliding"]
    surfaces = tuple(system.guard_names.index(one) for one in system.sliding)
    count = len(surfaces)
    slides = Slides(surfaces, system.n_guards, system.n_modes)
    n_memory = 2 * count
    if system.on_zeno == "rest":
        n_memory += count * system.n_states
    names: dict[str, Any] = {
        "M": count,
        "OWN": n_memory,
        "N_GUARDS": system.n_guards,
        "N_MODES": system.n_modes,
        "SURFACES": surfaces,
        "FIELD": system.field.dispatcher,
        "GUARDS": system.guards.dispatcher,
    }
    users: tuple[Callback, ...] = (system.field, system.guards)
    inner = system.field
    names["HANDLER"] = put_in(no_handler)
    if system.on_event is not None:
        names["HANDLER"] = system.on_event.dispatcher
        inner = system.on_event
        users = (*users, inner)
    insert_templates(names, rests=system.on_zeno == "rest")
    field = Mixed("field", field_template, system.field, users, **names)
    guards = Mixed("guards", guards_template, system.guards, users, **names)
    handler = Mixed("on_event", handler_template, inner, users, **names)
    none = (0,) * system.n_guards
    ending = [f"{one} lets go" for one in system.sliding]
    made = replace(
        system,
        field=field,
        guards=guards,
        on_event=handler,
        undo=None,
        jacobian=None,
        affine=None,
        sparsity=None,
        guard_names=(*ending, *system.guard_names),
        directions=(*((1,) * count), *(system.directions or none)),
        terminal=(*((0,) * count), *(system.terminal or none)),
        n_extra_modes=system.n_extra_modes + count,
        n_memory=system.n_memory + n_memory,
        sliding=(),
        on_zeno="stop",
    )
    vars(made).update(way=system.way, n_shown=system.n_shown, slides=slides)
    if system.on_zeno == "rest":
        vars(made)["rests"] = tuple(count + k for k in surfaces)
    system.made["sliding"] = made
    return made
