"""Files, lines of code and share of imports of the library, for each room.

    python tests/house_size.py

Docstrings, comments and blank lines do not count. `tests/test_architecture.py` sets the limits.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from statistics import median

LIBRARY = Path(__file__).parents[1] / "src" / "hopdata"
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass(frozen=True)
class Size:
    """Lines of code of a file, and how many of them are imports."""

    lines: int
    imports: int


def size_of(path: Path) -> Size:
    """Count the lines of a file."""
    text = path.read_text(encoding="utf-8")
    aside, imports = set(), 0
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            aside.update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
        if isinstance(node, ast.Import | ast.ImportFrom):
            imports += node.end_lineno - node.lineno + 1
    numbered = enumerate((line.strip() for line in text.splitlines()), start=1)
    return Size(sum(bool(x) and x[0] != "#" and n not in aside for n, x in numbered), imports)


def rooms() -> dict[str, list[Size]]:
    """Return the sizes of all files by their folder in the library."""
    found = defaultdict(list)
    for path in sorted(LIBRARY.rglob("*.py")):
        inside = path.relative_to(LIBRARY).parts
        found[inside[0] if len(inside) > 1 else "."].append(size_of(path))
    return dict(found)


if __name__ == "__main__":
    sizes = rooms()
    sizes["all"] = [one for room in sizes.values() for one in room]
    for name, room in sizes.items():
        lines, imports = sum(x.lines for x in room), sum(x.imports for x in room)
        print(
            f"{name:12}{len(room):4} files{lines:7} lines of code, median "
            f"{median(x.lines for x in room):3.0f}, imports {100 * imports / lines:4.1f} %"
        )
