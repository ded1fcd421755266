# ruff: noqa: ARG002 (Numba prescribes signatures)
"""The private parts of Numba that hopdata needs, as functions with plain arguments.

Numba's public interface cannot define types like those of `hybrid`: arrays without
owners, and numbers for which a user's functions compile as they are; and it does not
tell what may be kept in its cache. Here stands what is imported of what is private,
but for `hybrid.compiled.linking`, without which everything works more slowly. An
import fails here if a version of Numba lacks a name that nothing works without:

`caching`
    The files of the cache, to seal them and to choose what is kept.
`cgutils`
    Structures of the generated code, whose members a type defines.
`np.arrayobj`
    Arrays that are made from an address.
`np`
    Its functions of arrays, whose import of SciPy's linear algebra is put off.
`ir_utils`
    The exception by which a rewriting of Numba's gives up.
`typeconv`
    That a plain number may stand where a type of ours is wanted.
`typing.templates`
    What an operator, a method or an attribute means for a type of ours, asked before
    what Numba defines.
`config`
    The name of the file of settings in the working folder (`_config_fname`).

A function that builds generated code takes Numba's context and LLVM's builder.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO

from numba import config, types
from numba.core import caching, cgutils
from numba.core.ir_utils import GuardException
from numba.core.typeconv import Conversion
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    infer_getattr,
    infer_global,
    signature,
)
from numba.np.arrayobj import make_array, populate_array

#: What a rewriting of Numba's raises to leave the code as it is.
LEFT_AS_IT_IS: type[Exception] = GuardException

#: What `can_convert_from` of a type returns for what converts to it without a loss.
CONVERTS: Any = Conversion.safe


# The cache.


class CacheFiles(caching.IndexDataCacheFile):  # type: ignore[misc]
    """Numba's files of one function: an index of types, and machine code for each.

    By itself it does what Numba does. Numba does not look at what stands behind the
    content of a file.
    """

    def may_be_kept(self, key: Any) -> bool:
        """Return whether machine code for the types in `key` may be in the cache."""
        return True

    def is_sound(self, path: Path) -> bool:
        """Return whether a file may be read; Numba compiles anew otherwise."""
        return True

    def finish(self, file: BinaryIO) -> None:
        """End a file that Numba has written."""

    def load(self, key: Any) -> Any:
        """Return what is kept for the types in `key`, or None."""
        return super().load(key) if self.may_be_kept(key) else None

    def save(self, key: Any, data: Any) -> None:
        """Keep machine code, unless its types forbid it."""
        if self.may_be_kept(key):
            super().save(key, data)

    def _load_index(self) -> dict[Any, str]:
        if not self.is_sound(Path(self._index_path)):
            return {}
        index: dict[Any, str] = super()._load_index()
        return index

    def _load_data(self, name: str) -> Any:
        path = Path(self._data_path(name))
        if not self.is_sound(path):
            raise FileNotFoundError(path)
        return super()._load_data(name)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[BinaryIO]:
        with super()._open_for_write(filepath) as file:
            yield file
            self.finish(file)


@contextmanager
def cache_of(files: type[CacheFiles]) -> Iterator[None]:
    """Let Numba keep the functions that are decorated meanwhile in files of a class."""
    numbas_own = caching.IndexDataCacheFile
    caching.IndexDataCacheFile = files  # type: ignore[misc]
    try:
        yield
    finally:
        caching.IndexDataCacheFile = numbas_own  # type: ignore[misc]


def read_no_settings() -> None:
    """Let Numba, which looks again at each compilation, read no file of settings."""
    vars(config)["_config_fname"] = os.devnull


# What names mean for types of ours.


class FirstTried(AbstractTemplate):
    """Meaning of an operator for our types, tried before all that Numba defines."""

    metadata = {"target": "cpu"}  # noqa: RUF012


def ask_first(key: Any, template: Any) -> None:
    """Let Numba ask a template (`FirstTried`) first for the meaning of an operator."""
    template.key = key
    infer_global(key)(template)


def tried_first(key: Any, typed: Callable[..., Any], literal: bool = False) -> None:
    """Give an operator a meaning for our types.

    `typed(*types)` returns its signature, or None. With `literal`, the types of literal
    numbers are tried first.
    """

    class Template(FirstTried):
        prefer_literal = literal

        def generic(self, args: Any, kws: Any) -> Any:
            return typed(*args)

    ask_first(key, Template)


def attributes_of(kind: Any, typed: Callable[[Any, str], Any]) -> None:
    """Give attributes to a class of types.

    `typed(owner, name)` returns the type of the attribute, or None if there is none.
    """

    class Attributes(AttributeTemplate):
        key = kind

        def generic_resolve(self, owner: Any, name: str) -> Any:  # type: ignore[override]
            return typed(owner, name)

    infer_getattr(Attributes)


def method_first(
    kind: Any, name: str, fits: Callable[[Any], bool], typed: Callable[..., Any]
) -> Any:
    """Give a method a meaning for types that fit; return the key of its code.

    `typed(context, owner, arguments)` returns the type of its result, or None.
    """
    code = (kind, f"hopdata.{name}")

    class Method(AbstractTemplate):
        key = code
        this: Any = None  # the owner, which Numba sets

        def generic(self, args: Any, kws: Any) -> Any:
            found = None if kws else typed(self.context, self.this, args)
            return None if found is None else signature(found, *args, recvr=self.this)

    class Methods(AttributeTemplate):
        key = kind
        metadata = {"target": "cpu"}  # noqa: RUF012

        def generic_resolve(self, owner: Any, attribute: str) -> Any:  # type: ignore[override]
            if attribute != name or not fits(owner):
                return None
            return types.BoundFunction(Method, owner)

    infer_getattr(Methods)
    return code


# Structures and arrays of the generated code.


def structure(context: Any, builder: Any, kind: Any, value: Any = None) -> Any:
    """Return a structure of the generated code, whose members are attributes.

    Without `value`, they are to be set; `packed` then gives the whole.
    """
    return cgutils.create_struct_proxy(kind)(context, builder, value)


def packed(whole: Any) -> Any:
    """Build the value of a structure whose members are set."""
    return whole._getvalue()


def items_of(builder: Any, value: Any, count: int) -> list[Any]:
    """Build the items of a tuple of this length."""
    items: list[Any] = cgutils.unpack_tuple(builder, value, count)
    return items


def array_from(
    context: Any, builder: Any, kind: Any, start: Any, shape: Any, strides: Any
) -> Any:
    """Build an array without an owner, from the pointer to its first item on.

    `shape` and `strides` (in bytes) have an entry for each axis; the items lie side by
    side along the last.
    """
    array = make_array(kind)(context, builder)
    populate_array(array, start, shape, strides, strides[-1], meminfo=None)
    return array._getvalue()


def array_start(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Build the pointer to the first item of an array."""
    return make_array(kind)(context, builder, value).data


def array_shape(context: Any, builder: Any, kind: Any, value: Any) -> list[Any]:
    """Build the lengths of an array along its axes."""
    shape = make_array(kind)(context, builder, value).shape
    return items_of(builder, shape, kind.ndim)


def room_with(builder: Any, value: Any) -> Any:
    """Build the pointer to room on the stack that holds a value."""
    return cgutils.alloca_once_value(builder, value)


def is_null(builder: Any, pointer: Any) -> Any:
    """Build whether a pointer points nowhere."""
    return cgutils.is_null(builder, pointer)


# A quicker start.


@cache
def load_numba_arrays() -> None:
    """Import Numba's functions of arrays without SciPy's linear algebra.

    Numba imports `scipy.linalg` only to see whether it is there, which takes a fifth of
    a first solve. So it is looked for on the disk. Functions that need it import it
    when they are compiled or first called.
    """
    try:
        from numba.np import linalg

        ensure_blas = linalg.ensure_blas
        fits = linalg._check_lapack_int_width
    except (ImportError, AttributeError):  # another version of Numba
        return

    def look_for_blas() -> None:
        found = find_spec("scipy")
        places = (found and found.submodule_search_locations) or ()
        if not any(any(Path(one).glob("linalg/cython_blas.*")) for one in places):
            raise ImportError("scipy")
        fits()

    linalg.ensure_blas = look_for_blas
    try:
        from numba.np import arraymath

        vars(arraymath)["ensure_blas"] = ensure_blas
    finally:
        linalg.ensure_blas = ensure_blas
