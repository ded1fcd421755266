"""YAML from elsewhere: which texts are loaded, and into which values.

A text is first read as a stream of events, which takes no memory and no stack, and
levels, entries and directives are counted. The parser in C would otherwise overrun the
stack at some 10,000 brackets, which ends the process, and fill the memory with nodes.
Then its aliases are counted as what they repeat. What is loaded are mappings, lists,
texts, numbers, truth values and dates: other tags are refused, as are numbers with more
digits than any can mean, and a key that is there twice.

This happens in this process, unlike all reading by other libraries: the work is bounded
by the counts, which `tests/foreign/test_yaml_texts.py` measures, and a configuration is
read several times in each command.
"""

from __future__ import annotations

import re
from typing import Any

import yaml

from hopdata.errors import ConfigError
from hopdata.foreign.texts import (
    COUNTED_UP_TO,
    LONGEST_NUMBER,
    MOST_LEVELS,
    too_many,
)
from hopdata.messages import Message

#: Entries of a text, also once each alias stands for what it repeats: keys and values,
#: with lists and mappings among the values.
#: Unit: 1. Origin: chosen.
MOST_ENTRIES = 100_000

# Lines that begin with %, of which a text may have `%YAML` and a `%TAG` or two. The
# parser compares each with all others.
_DIRECTIVE = re.compile(r"^%", re.MULTILINE)
_MOST_DIRECTIVES = 10

_TAG = "tag:yaml.org,2002:"
# Kinds of values that are loaded; "merge" is the key "<<".
_NUMBERS = ("int", "float", "bool", "null", "timestamp")
_KINDS = ("map", "seq", "str", "merge", *_NUMBERS)


class StrictLoader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Safe loader of plain values; it refuses a key that is there twice."""

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """Make a value; PyYAML raises almost anything if tag and text do not fit."""
        kind = node.tag.removeprefix(_TAG)
        if kind not in _KINDS:
            raise at_node(f"the tag '{node.tag[:40]}', which is not used here", node)
        if kind in _NUMBERS and len(node.value) > LONGEST_NUMBER:
            found = f"'{node.value[:10]}...' with {len(node.value)} characters"
            raise at_node(f"{found}, which is no {kind}", node)
        try:
            return super().construct_object(node, deep)
        except (yaml.YAMLError, RecursionError):
            raise
        except Exception:
            raise at_node(f"a value that is no {kind}", node) from None

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        """Make a mapping, whose keys are plain values that differ."""
        seen = set()
        for key_node, _ in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise at_node("a key that is no plain text", key_node)
            key = str(key_node.value)
            # "<<" merges another mapping, and may do so several times.
            if key in seen and key != "<<":
                raise at_node(f"the key '{key}' twice in one place", key_node)
            seen.add(key)
        return super().construct_mapping(node, deep)


def at_node(problem: str, node: Any) -> yaml.MarkedYAMLError:
    """Return the error about a node."""
    return yaml.constructor.ConstructorError(None, None, problem, node.start_mark)


def loaded(text: str, place: object) -> Any:
    """Return the values of a text in YAML; None of an empty one.

    Parameters
    ----------
    text : str
    place : object
        What messages about its size begin with.

    Raises
    ------
    ConfigError
        If it has too many levels, entries or directives.
    yaml.YAMLError, ValueError
        If it is no YAML, or holds something else than plain values.
    """
    loader = StrictLoader(text)
    try:
        node = _root(text, loader, place)
        return None if node is None else loader.construct_document(node)
    except RecursionError:
        raise _too_deep(place) from None
    finally:
        loader.dispose()


def root_node(text: str, place: object) -> yaml.Node | None:
    """Return the node of a text, with the lines of its parts; see `loaded`."""
    loader = StrictLoader(text)
    try:
        return _root(text, loader, place)
    finally:
        loader.dispose()


def _root(text: str, loader: Any, place: object) -> yaml.Node | None:
    _require_few_events(text, place)
    node: yaml.Node | None = loader.get_single_node()
    if node is not None:
        _require_moderate(node, place)
    return node


def _require_few_events(text: str, place: object) -> None:
    """Count levels and entries without building anything."""
    if len(_DIRECTIVE.findall(text)) > _MOST_DIRECTIVES:
        raise ConfigError(Message("foreign.too_many_directives", {"place": f"{place}"}))
    n_levels = 0
    n_entries = 0
    for event in yaml.parse(text, Loader=StrictLoader):
        if isinstance(event, yaml.NodeEvent):
            n_entries += 1
        if n_entries > COUNTED_UP_TO * MOST_ENTRIES:
            break
        if isinstance(event, yaml.CollectionStartEvent):
            n_levels += 1
            if n_levels > MOST_LEVELS:
                raise _too_deep(place)
        elif isinstance(event, yaml.CollectionEndEvent):
            n_levels -= 1
    if n_entries > MOST_ENTRIES:
        told = too_many(place, "keys and values", n_entries, MOST_ENTRIES)
        raise ConfigError(told)


def _too_deep(place: object) -> ConfigError:
    values = {"place": f"{place}", "most": MOST_LEVELS}
    return ConfigError(Message("foreign.too_deep", values))


def _require_moderate(root: yaml.Node, place: object) -> None:
    """Refuse a text whose aliases expand to more than memory or stack can hold."""
    size, depth = _expanded(root, {})
    if size > MOST_ENTRIES:
        values = {"place": f"{place}", "most": MOST_ENTRIES, "found": size}
        raise ConfigError(Message("foreign.too_many_once_expanded", values))
    if depth > MOST_LEVELS + 1:
        raise _too_deep(place)


def _expanded(node: Any, known: dict[int, tuple[int, int]]) -> tuple[int, int]:
    """Return entries and levels of a node with aliases expanded, each node once."""
    if id(node) in known:
        return known[id(node)]
    known[id(node)] = (0, 0)  # recursive nodes are refused elsewhere
    size = 1
    depth = 0
    entries = node.value if isinstance(node.value, list) else []
    for entry in entries:
        # An entry of a mapping is a pair of key and value.
        parts = entry if isinstance(entry, tuple) else (entry,)
        for part in parts:
            inner_size, inner_depth = _expanded(part, known)
            size += inner_size
            depth = max(depth, inner_depth)
    known[id(node)] = (size, depth + 1)
    return known[id(node)]
