"""Pages as notebooks: where a page says so, its Python and shell blocks are run.

`run_pages` runs them before the site is built, and Sphinx takes what they printed and
drew. What a page shows is checked by code in its comments, which do not show either.
"""

import hashlib
import re
from pathlib import Path

import nbformat
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

#: Where `run_pages` keeps the pages that have run.
RAN = Path(__file__).parents[1] / "build" / "pages"

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
    """Return a page in Markdown as a notebook, with the results of its code.

    Raises
    ------
    FileNotFoundError
        If its code has not been run by `run_pages`.
    """
    if RUNS not in text:
        return new_notebook(cells=[new_markdown_cell(text)])
    page = as_written(text)
    path = place_of(page)
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: expected the results of a page whose code has run, found none; "
            "`make site` runs all pages first"
        )
    ran = nbformat.read(path, as_version=4)
    page.metadata = ran.metadata
    for cell, with_results in zip(page.cells, ran.cells, strict=True):
        if cell.cell_type == "code":
            cell.outputs = with_results.outputs
            cell.execution_count = with_results.execution_count
    return page


def place_of(page: NotebookNode) -> Path:
    """Return where the results of a page's code are kept, which has its own digest."""
    code = [cell.source for cell in page.cells if cell.cell_type == "code"]
    return RAN / f"{hashlib.sha256(chr(0).join(code).encode()).hexdigest()[:16]}.ipynb"


def as_written(text: str) -> NotebookNode:
    """Return a page whose code runs as a notebook, without results."""
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
