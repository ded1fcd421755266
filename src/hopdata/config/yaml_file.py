"""YAML as a user writes it: a key that stands twice is a mistake, not a choice."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from hopdata.errors import ConfigError

MOST_ENTRIES = 100_000


def read_yaml(path: str | Path) -> Any:
    """Read a YAML file.

    Raises
    ------
    ConfigError
        If the file cannot be read, is not YAML, names a key twice, or has aliases that would
        unfold to more than `MOST_ENTRIES`.
    """
    import yaml

    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(
            f"{path}: expected a readable configuration, found: {error.strerror or error}"
        ) from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: expected YAML in UTF-8, found other bytes") from None
    loader = None
    try:
        loader = _loader()(text)
        node = loader.get_single_node()
        if node is None:
            return None
        if (size := _expanded(node, {})) > MOST_ENTRIES:
            raise ConfigError(
                f"{path}: expected at most {MOST_ENTRIES} entries, found {size} once the aliases "
                "(*name) stand for what they repeat; write out what is needed"
            )
        return loader.construct_document(node)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        hint = _hint(error.problem, text[mark.index : mark.index + 1] if mark else "")
        raise ConfigError(f"{path}{where}: expected YAML, found: {error.problem}{hint}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: expected YAML, found: {error}") from None
    finally:
        if loader is not None:
            loader.dispose()


def _expanded(node: Any, known: dict[int, int]) -> int:
    """Count the entries of a node with its aliases written out, each node looked at once."""
    if id(node) not in known:
        known[id(node)] = 0  # one within itself is refused elsewhere
        inner = node.value if isinstance(node.value, list) else []
        parts = [
            part for entry in inner for part in (entry if isinstance(entry, tuple) else [entry])
        ]
        known[id(node)] = 1 + sum(_expanded(part, known) for part in parts)
    return known[id(node)]


def _hint(problem: str | None, character: str) -> str:
    """Say what usually is behind a message of the YAML parser about this character."""
    problem = problem or ""
    if "':'" in problem or "mapping values" in problem:
        return "; is there a space behind each colon, also in the line above?"
    if "\\t" in problem or "\t" in problem or character == "\t":
        return "; indent with spaces, not with tabs"
    return ""


@lru_cache(maxsize=1)
def _loader() -> Any:
    """Build the safe loader, which by itself lets the last of two equal keys win."""
    import yaml

    class StrictLoader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            seen = set()
            for key_node, _ in node.value:
                key = str(key_node.value)
                if key in seen and key != "<<":
                    raise yaml.constructor.ConstructorError(
                        None, None, f"the key '{key}' twice in one place", key_node.start_mark
                    )
                seen.add(key)
            return super().construct_mapping(node, deep)

    return StrictLoader
