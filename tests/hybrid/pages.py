"""The code of a page of the documents, as the site runs it."""

from __future__ import annotations

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
        # Functions are read from files, which the integrator needs as well.
        exec(compile(block, f"{page}:{number}", "exec"), names)
    return names
