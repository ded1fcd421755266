"""Pages as notebooks: where a page says so, its Python and shell blocks are run.

What a page shows is checked by code in its last comment, which does not show either.
"""

import re

from nbformat import NotebookNode
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

#: The line that says so; it does not show.
RUNS = "<!-- The code of this page is run when the site is built. -->"
CHECKED = "<!-- Checked when the site is built:"
BLOCK = re.compile(
    rf"^(?:```(python|console)|{CHECKED})\n(.*?)^(?:```|-->)$", re.MULTILINE | re.DOTALL
)
# Each page works in a folder of its own, with the checkout's recordings and
# configurations.
BEGIN = """
import os, shutil, sys, tempfile
from pathlib import Path
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
root = Path.cwd() if Path("Snakefile").exists() else Path.cwd().parent
os.chdir(tempfile.mkdtemp())
shutil.copytree(root / "config", "config")
Path("data").symlink_to(root / "data")
from IPython.core.pylabtools import select_figure_formats
select_figure_formats(get_ipython(), {"svg"})

# IPython's own magic prints what it reads from the shell in pieces that may end within
# a word, and the page shows each piece on a line of its own.
def bash(options, commands):
    import subprocess
    done = subprocess.run(
        ["bash", *options.split()], input=commands, text=True, encoding="utf-8",
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )
    print(done.stdout, end="", flush=True)
    if done.returncode:
        raise RuntimeError(f"the shell ended with exit code {done.returncode}")

get_ipython().register_magic_function(bash, "cell")
"""


def notebook(text: str) -> NotebookNode:
    """Return a page in Markdown as a notebook."""
    if RUNS not in text:
        page = new_notebook(cells=[new_markdown_cell(text)])
        page.metadata["mystnb"] = {"execution_mode": "off"}
        return page
    cells = [new_code_cell(BEGIN, metadata={"tags": ["remove-cell"]})]
    words, *blocks = BLOCK.split(text)
    cells.append(new_markdown_cell(words))
    for kind, code, words in zip(*[iter(blocks)] * 3, strict=True):
        lines = code.rstrip().splitlines()
        hidden = {} if kind else {"tags": ["remove-cell"]}
        code = "\n".join(["%%bash -e"] * (kind == "console") + lines)
        cells.append(new_code_cell(code, metadata=hidden))
        cells.append(new_markdown_cell(words))
    page = new_notebook(cells=cells)
    page.metadata["kernelspec"] = {
        "name": "python3",
        "display_name": "Python 3",
        "language": "python",
    }
    return page
