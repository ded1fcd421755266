"""The derived system, made from the templates of this package."""

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
from hopdata.hybrid.numbers.ranges import part_of_results, sink
from hopdata.hybrid.sliding import guards, handler, mix, reactions
from hopdata.hybrid.sliding.records import Slides

Names = dict[str, Any]

# The templates, by the names under which others call them. Each may call those before
# it.
TEMPLATES: Names = {
    "CORNERS": mix.corners_template,
    "DIFFER": mix.differs_template,
    "SLIDE": mix.slide_template,
    "APPROACH": reactions.approach_template,
    "ALONG": reactions.along_template,
    "BENDS": reactions.bends_template,
    "MIX": reactions.mix_template,
    "SHARES": guards.shares_template,
    "ENDS": guards.ends_template,
    "RATES": handler.rates_template,
    "LOSES": handler.depends_template,
    "TERMS": handler.terms_template,
    "BEGINS": handler.begins_template,
    "LEAVE": handler.leave_template,
    "CALL": handler.call_template,
    "RELEASE": handler.release_template,
    "REST": reactions.rest_template,
    "DECIDE": handler.decide_template,
}

# What takes the place of a template where no guard may rest; None: nothing.
WITHOUT_REST: Names = {
    "APPROACH": reactions.no_approach,
    "ALONG": None,
    "BENDS": None,
    "MIX": None,
    "REST": reactions.no_rest,
}

# What takes their place where the user's functions do not compile for numbers that
# move.
BY_DIFFERENCES: Names = {
    "ALONG": reactions.along_by_differences,
    "BENDS": reactions.bends_by_differences,
    "ENDS": guards.ends_by_differences,
}

# Those for other numbers: duals, ranges, and numbers of any kind that move. As APPROACH
# is written for any of them, it is MOVED_APPROACH, too.
OF_NUMBERS: Names = {
    "RATED": mix.rated_template,
    "CORNERS": mix.corners_template,
    "DIFFER": mix.never_differs,
    "SLIDE": mix.slide_template,
    "APPROACH": reactions.approach_template,
    "MOVED_APPROACH": None,
    "ALONG": reactions.along_template,
    "BENDS": reactions.bends_template,
    "MIX": reactions.mix_template,
    "SHARES": guards.shares_template,
    "ENDS": guards.ends_of_numbers,
    "CALL": handler.call_template,
}
ONLY_FOR_REST = ("APPROACH", "MOVED_APPROACH", "ALONG", "BENDS", "MIX")


def for_numbers(template: Callable[..., Any], **names: Any) -> Any:
    """Return a function made from a template, callable with any kind of number."""
    return kernel_apart(with_digest(template, **names))


def names_of_numbers(system: Any, sizes: Names, *, rests: bool) -> Names:
    """Return what is inserted into the templates for other numbers than floats."""
    names = dict(sizes)
    names["FIELD"] = system.field.dual
    names["GUARDS"] = system.guards.dual
    names["HANDLER"] = put_in(handler.no_handler)
    if system.on_event is not None:
        names["HANDLER"] = system.on_event.dual
    for name, template in OF_NUMBERS.items():
        if rests or name not in ONLY_FOR_REST:
            if name == "MOVED_APPROACH":
                names[name] = names["APPROACH"]
            else:
                names[name] = for_numbers(template, **names)
        elif name == "MIX":
            names[name] = names["SLIDE"]
    return names


def names_of_floats(
    system: Any, sizes: Names, of_numbers: Names | None, *, rests: bool
) -> Names:
    """Return what is inserted into the templates for floats.

    Without rest, its parts are left out, which halves the time of compilation. Without
    functions for other numbers, rates are differences.
    """
    names = dict(sizes)
    names["FIELD"] = system.field.dispatcher
    names["GUARDS"] = system.guards.dispatcher
    names["RATED"] = names["GUARDS"]
    names["HANDLER"] = put_in(handler.no_handler)
    if system.on_event is not None:
        names["HANDLER"] = system.on_event.dispatcher
    chosen = dict(TEMPLATES)
    chosen["TIES"] = handler.no_ties
    if system.together is not None:
        names["LAW"] = system.together.dispatcher
        chosen["TIES"] = handler.ties_template
    if of_numbers is None:
        chosen |= BY_DIFFERENCES
    else:
        names["MOVED_APPROACH"] = of_numbers.get("APPROACH")
        names["MOVED_SHARES"] = of_numbers["SHARES"]
    if not rests:
        chosen |= WITHOUT_REST
    for name, template in chosen.items():
        if name in ("BENDS", "ENDS") and of_numbers is None:
            known = names
            if name == "BENDS":  # the rates of what APPROACH gives
                known = {**names, "SHARES": names.get("APPROACH")}
            names["RATE"] = kernel_apart(with_digest(guards.rate_template, **known))
        if template is not None:
            names[name] = kernel_apart(with_digest(template, **names))
        elif name == "MIX":
            names[name] = names["SLIDE"]
    return names


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
    floats, by_differences : dict
        What is inserted into the template; the second, where the first does not
        compile.
    dual, ranged : callable, optional
        The function for duals and for ranges, for compiled code.
    """

    def __init__(
        self,
        kind: str,
        template: Callable[..., Any],
        inner: Callback,
        users: tuple[Callback, ...],
        *,
        floats: Names,
        by_differences: Names,
        dual: Any,
        ranged: Any = None,
    ) -> None:
        super().__init__(with_digest(template, **floats), SIGNATURES[kind])
        self.inner = inner
        self._users = users
        self._otherwise = with_digest(template, **by_differences)
        self._dual = dual
        self._ranged = ranged
        # Otherwise the code contains the address of a Python function.
        self.kept = self.compiled

    def _made(self) -> Any:
        """Return the machine code; where rates are not exact, by differences."""
        try:
            return self._compiled_now()
        # Numba's own exceptions, and others raised within it.
        except Exception:
            self.function = self._otherwise
            return self._compiled_now()

    @cached_property
    def dispatcher(self) -> Any:
        """The function, callable from other code in Numba."""
        _ = self._compiled  # decides which of the two it is
        return put_in(self.function)

    @property
    def dual(self) -> Any:  # type: ignore[override]
        """The function, callable from code in Numba with duals."""
        return self._dual

    @property
    def ranged(self) -> Any:  # type: ignore[override]
        """The function, callable from code in Numba with ranges."""
        return self._ranged

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


def _functions(system: Any, sizes: Names, *, rests: bool) -> tuple[Mixed, Mixed, Mixed]:
    """Return field, guards and handler of the derived system."""
    users: tuple[Callback, ...] = (system.field, system.guards)
    inner = system.field
    if system.on_event is not None:
        inner = system.on_event
        users = (*users, inner)
    if system.together is not None:
        users = (*users, system.together)
    of_numbers: Names | None = None
    by_differences = names_of_floats(system, sizes, None, rests=rests)
    floats = by_differences
    if system.field.compiled and system.guards.compiled:
        of_numbers = names_of_numbers(system, sizes, rests=rests)
        floats = names_of_floats(system, sizes, of_numbers, rests=rests)
    kinds: dict[str, tuple[Any, Any, Callback]] = {
        "field": (mix.field_template, mix.field_template, system.field),
        "guards": (guards.guards_template, guards.guards_template, system.guards),
        "on_event": (handler.handler_template, handler.handler_of_duals, inner),
    }
    made = []
    for kind, (template, of_duals, own) in kinds.items():
        dual = None
        ranged = None
        if of_numbers is not None:
            decides = {"DECIDE": floats["DECIDE"], "RELEASE": floats["RELEASE"]}
            dual = for_numbers(of_duals, **of_numbers, **decides)
            parts = {"PART_OF_RESULTS": part_of_results, "SINK": sink}
            names = {**of_numbers, **parts}
            if kind == "field":
                ranged = for_numbers(mix.field_of_ranges, **names)
            if kind == "guards":
                names["GUARDS"] = system.guards.ranged
                ranged = for_numbers(guards.guards_of_ranges, **names)
        callbacks = {"floats": floats, "by_differences": by_differences}
        one = Mixed(kind, template, own, users, dual=dual, ranged=ranged, **callbacks)
        made.append(one)
    return made[0], made[1], made[2]


def sliding_system(system: Any) -> Any:
    """Return the derived system that slides along the guards declared for it."""
    if "sliding" in system.made:
        return system.made["sliding"]
    surfaces = tuple(system.guard_names.index(one) for one in system.sliding)
    count = len(surfaces)
    n_due = 0
    if system.together is not None:  # directions of all guards that are due
        n_due = count + system.n_guards
    slides = Slides(surfaces, system.n_guards, system.n_modes, n_due)
    rests = system.on_zeno == "rest"
    n_memory = 2 * count  # an offset and a size for each
    if rests:  # a direction for each
        n_memory += count * system.n_states
    sizes: Names = {
        "N": system.n_states,
        "M": count,
        "OWN": n_memory,
        "N_GUARDS": system.n_guards,
        "N_MODES": system.n_modes,
        "N_FIELDS": (count + 1) * system.n_states,
        "N_RATES": (count + 1) * system.n_guards,
        "N_MATRIX": count * count,
        "SURFACES": surfaces,
    }
    field, events, handles = _functions(system, sizes, rests=rests)
    none = (0,) * system.n_guards
    ending = [f"{one} lets go" for one in system.sliding]
    made = replace(
        system,
        field=field,
        guards=events,
        on_event=handles,
        undo=None,
        jacobian=None,
        affine=None,
        sparsity=None,
        guard_names=(*ending, *system.guard_names),
        directions=(*((1,) * count), *(system.directions or none)),
        terminal=(*((0,) * count), *(system.terminal or none)),
        n_extra_modes=system.n_extra_modes + count + n_due,
        together=None,
        n_memory=system.n_memory + n_memory,
        sliding=(),
        on_zeno="stop",
    )
    vars(made).update(way=system.way, n_shown=system.n_shown, slides=slides)
    vars(made)["by_law"] = system.together is not None
    if system.on_zeno == "rest":
        vars(made)["rests"] = tuple(count + k for k in surfaces)
    system.made["sliding"] = made
    return made
