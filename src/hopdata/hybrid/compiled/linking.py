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
from llvmlite.binding import Linkage
from numba import _dynfunc, njit, types  # type: ignore[attr-defined]
from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import (
    InlineOverloads,
    NativeLowering,
    NopythonRewrites,
    NopythonTypeInference,
)
from numba.core.untyped_passes import (
    FindLiterallyCalls,
    InlineClosureLikes,
    InlineInlinables,
    WithLifting,
)

from hopdata.hybrid.compiled.memory import View

Function = Callable[..., Any]

# Rewrites of array sums, and of closures.
NOT_NEEDED = (NopythonRewrites, InlineClosureLikes)
# Our kernels have no contexts, no functions to inline before they are lowered, and no
# calls that want literals.
NOT_IN_KERNELS = (
    *NOT_NEEDED,
    FindLiterallyCalls,
    InlineInlinables,
    InlineOverloads,
    WithLifting,
)

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
    is_optimised_once = False

    def _optimize_functions(self, ll_module: Any) -> None:
        """Leave a function as translated; optimisation follows linking."""
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        """Optimise an entry, once if that is enough.

        Numba does it twice, so that counts of references meet and cancel, and more
        loops become vector instructions.
        """
        if self.is_optimised_once:
            passes, builder = self._codegen._module_pass_manager()
            passes.run(self._final_module, builder)
        else:
            super()._optimize_final_module()
        _hide_what_it_reaches(self._final_module)

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


def _hide_what_it_reaches(module: Any) -> None:
    """Let machine code that is loaded later not find the functions that an entry calls.

    LLVM takes the first function of a name for all that have it. Numba names functions
    by what they are called in their source and by a number that counts in a process. So
    two functions of one factory have the same name where two processes compiled them,
    and a third one that loads both from the cache would run one in place of the other.
    """
    for function in module.functions:
        if function.linkage == Linkage.linkonce_odr and not function.is_declaration:
            function.linkage = Linkage.internal


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
    is_optimised_once = False

    def run_pass(self, state: Any) -> bool:
        state.library = _Library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        state.library.is_entry = True
        state.library.is_optimised_once = self.is_optimised_once
        return bool(super().run_pass(state))


@register_pass(mutates_CFG=True, analysis_only=False)
class _LowerLargeEntry(_LowerEntry):
    _name = "large_entry"
    is_optimised_once = True


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


class _Remembering:
    """A context of types that remembers what a call of an operation gives.

    Numba tries all meanings of an operation at each call, and again as long as any type
    in the function is open: most of them are refused by an exception. Functions are not
    remembered, as they may be compiled anew.
    """

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function: Any, given: Any, named: Any) -> Any:
        """Return the signature of a call with arguments of these types."""
        resolve = self._context.resolve_function_type
        if type(function) is not types.Function or named:
            return resolve(function, given, named)
        if not all(isinstance(one, _PLAIN) for one in given):
            return resolve(function, given, named)
        key = function, given
        if key not in _RESOLVED:
            found = resolve(function, given, named)
            if found is None:
                return found
            _RESOLVED[key] = found
        return _RESOLVED[key]


# Types of numbers, views and tuples of them: not of functions, or of open types.
_PLAIN = (types.Number, types.Boolean, types.Literal, types.BaseTuple, View)
_RESOLVED: dict[Any, Any] = {}


@register_pass(mutates_CFG=True, analysis_only=False)
class _Inference(NopythonTypeInference):
    _name = "inference"

    def run_pass(self, state: Any) -> bool:
        context = state.typingctx
        state.typingctx = _Remembering(context)
        try:
            return bool(super().run_pass(state))
        finally:
            state.typingctx = context


class Entry(CompilerBase):
    """Compiler of functions that are called from outside."""

    lowering: Any = _LowerEntry
    not_needed: tuple[Any, ...] = NOT_NEEDED

    def define_pipelines(self) -> list[Any]:
        """Return Numba's passes that are needed, with the last but one replaced."""
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes = [one for one in manager.passes if one[0] not in self.not_needed]
        manager.passes = []
        for one, why in passes:
            chosen = one
            if one is NativeLowering:
                chosen = self.lowering
            elif one is NopythonTypeInference:
                chosen = _Inference
            manager.passes.append((chosen, why))
        manager.finalize()
        return [manager]


class LargeEntry(Entry):
    """Compiler of large functions without references, which are optimised once."""

    lowering = _LowerLargeEntry


class Kernel(Entry):
    """Compiler of functions that are called by compiled code."""

    lowering = _LowerKernel
    not_needed = NOT_IN_KERNELS


class Apart(Kernel):
    """Compiler of functions that are never inlined into their callers."""

    lowering = _LowerApart


class IntoOther(Kernel):
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
