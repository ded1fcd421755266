"""The code of a page of the documents, as the site runs it."""

from __future__ import annotations

import linecache
import re
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
CODE = re.compile(
    r"^(?:```python|<!-- Checked when the site is built:)\n(.*?)^(?:```|-->)$",
    re.MULTILINE | re.DOTALL,
)


def run_page(name):
    """Run all code of a page in order, its checks too; return the names that it has made."""
    page = DOCS / f"{name}.md"
    blocks = CODE.findall(page.read_text(encoding="utf-8"))
    assert blocks, page
    names = {"__name__": "__main__"}
    for number, block in enumerate(blocks):
        # The integrator reads the source of functions, as in a notebook.
        file = f"{page}:{number}"
        linecache.cache[file] = (len(block), None, block.splitlines(True), file)
        exec(compile(block, file, "exec"), names)
    return names
