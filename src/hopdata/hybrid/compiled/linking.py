"""Kernels are translated one by one; they are linked and optimised for their entry.

By default, Numba does all of this for each function and everything it calls, and again
for each caller: nearly the same code repeatedly, five sixths of the time. Here a kernel
remains as translated, and an entry, which is called from outside, links everything it
reaches.

Numba itself is not modified: a code library and passes defined here are selected by
kernels and entries through `pipeline_class`. Of Numba's internals this uses `codegen`
(the library), `compiler`, `compiler_machinery`, `typed_passes`, `untyped_passes`,
`lowering` (our passes), `registry` and `_dynfunc` (a placeholder for a kernel that is
not compiled by itself). The import fails with ImportError if Numba lacks one of them;
kernels are then compiled in Numba's own way.
"""

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

from llvmlite import ir
from numba import _dynfunc, njit, types  # type: ignore[attr-defined]
from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering, NopythonRewrites
from numba.core.untyped_passes import InlineClosureLikes

Function = Callable[..., Any]

# Rewrites of array sums, and of closures.
NOT_NEEDED = (NopythonRewrites, InlineClosureLikes)

_MADE = {"_final_module", "_linking_libraries", "_shared_module"}
_NEEDED = (
    "finalize",
    "_finalize_dynamic_globals",
    "_get_module_for_linking",
    "_optimize_functions",
)
if not _MADE.issubset(CPUCodeLibrary.__init__.__code__.co_names) or not all(
    hasattr(JITCodeLibrary, name) for name in _NEEDED
):
    raise ImportError("Numba's code library is not the one that is known here")


class _Library(JITCodeLibrary):
    """A kernel as translated, or an entry with everything it reaches."""

    is_entry = False

    def _optimize_functions(self, ll_module: Any) -> None:
        """Leave a function as translated; optimisation follows linking."""
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        if self.is_entry:
            self._link()
            super().finalize()
        else:
            self._finalize_dynamic_globals()
            self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """Return the code for a library of Numba's, which links direct callees only."""
        if self._linking_libraries:
            self._link()
            self._shared_module = None
        return super()._get_module_for_linking()

    def _link(self) -> None:
        for library in _callers_first(self):
            own = CPUCodeLibrary._get_module_for_linking(library)  # only its own code
            self._final_module.link_in(own, preserve=True)
        self._linking_libraries = []


def _callers_first(root: _Library) -> Iterator[Any]:
    """Yield the libraries that one reaches, callers first.

    LLVM drops functions that nothing refers to yet.
    """
    seen: set[Any] = set()
    order: list[Any] = []

    def visit(library: Any) -> None:
        if not isinstance(library, _Library):
            return
        for called in library._linking_libraries:
            if called not in seen:
                seen.add(called)
                visit(called)
                order.append(called)

    visit(root)
    return reversed(order)


@register_pass(mutates_CFG=True, analysis_only=False)
class _LowerEntry(NativeLowering):
    _name = "entry"

    def run_pass(self, state: Any) -> bool:
        state.library = _Library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        state.library.is_entry = True
        return bool(super().run_pass(state))


@register_pass(mutates_CFG=True, analysis_only=False)
class _LowerKernel(NativeLowering):
    _name = "kernel"

    def run_pass(self, state: Any) -> bool:
        state.library = _Library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        made = state["cr"]
        name, module = made.fndesc.qualname, made.fndesc.lookup_module()
        callee = _dynfunc.make_function(module, name, "", 0, made.env, (state.library,))
        state.targetctx.insert_user_function(callee, made.fndesc, [state.library])
        result = type(made)
        state["cr"] = result(made.fndesc, made.call_helper, cfunc=callee, env=made.env)
        return True


class _Apart(Lower):
    def setup_function(self, fndesc: Any) -> None:
        super().setup_function(fndesc)
        self.function.attributes.discard("alwaysinline")
        self.function.attributes.add("noinline")


@register_pass(mutates_CFG=True, analysis_only=False)
class _LowerApart(_LowerKernel):
    _name = "kernel_apart"
    lowering_class = _Apart


class _IntoOther(_Apart):
    def setup_function(self, fndesc: Any) -> None:
        super().setup_function(fndesc)
        for argument in self.function.args:
            if isinstance(argument.type, ir.PointerType):
                argument.add_attribute("noalias")


@register_pass(mutates_CFG=True, analysis_only=False)
class _LowerIntoOther(_LowerKernel):
    _name = "kernel_into_other"
    lowering_class = _IntoOther


class Entry(CompilerBase):
    """Compiler of functions that are called from outside."""

    lowering: Any = _LowerEntry

    def define_pipelines(self) -> list[Any]:
        """Return Numba's passes that are needed, with the last but one replaced."""
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes = [one for one in manager.passes if one[0] not in NOT_NEEDED]
        manager.passes = []
        for one, why in passes:
            chosen = self.lowering if one is NativeLowering else one
            manager.passes.append((chosen, why))
        manager.finalize()
        return [manager]


class Kernel(Entry):
    """Compiler of functions that are called by compiled code."""

    lowering = _LowerKernel


class Apart(Entry):
    """Compiler of functions that are never inlined into their callers."""

    lowering = _LowerApart


class IntoOther(Entry):
    """The same, of functions that write to no place that another argument reads."""

    lowering = _LowerIntoOther


class _KernelDispatcher(CPUDispatcher):
    """A kernel, translated once whether or not its arguments are literal.

    For calls from Python it is compiled by itself, as Numba compiles functions.
    """

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return the template of a call with arguments of these types."""
        return super().get_call_template(tuple(map(types.unliteral, args)), kws)

    def __call__(self, *arguments: Any) -> Any:
        return _compiled_alone(self.py_func)(*arguments)


@cache
def _compiled_alone(function: Function) -> Any:
    return njit(error_model="numpy")(function)


def linked(compiler: type[Entry], function: Function, **options: Any) -> Any:
    """Return a function as a kernel, without the code for calls from Python."""
    options |= {
        "no_cpython_wrapper": True,
        "no_cfunc_wrapper": True,
        "pipeline_class": compiler,
    }
    kernel: Any = njit(error_model="numpy", **options)(function)
    kernel.__class__ = _KernelDispatcher
    return kernel
