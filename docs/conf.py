"""The site: the pages in docs/ and beside it, and those of them whose code is run.

Its root is the checkout, so that README, docs and benchmarks link to each other as they
do there.
"""

import re
import sys
from pathlib import Path

from docutils.nodes import SkipNode, literal_block
from latex2mathml.converter import convert

from hopdata import __version__ as release

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs"))  # executed_pages

#: The contents at the side, by what a reader came for: tutorials to follow, guides for a
#: task, explanations to understand, and what is looked up.
PAGES = {
    "Tutorials": [
        "first_study", "real_recording", "notebook", "plan", "steering",
        "another_robot", "new_scene",
    ],
    "How to": [
        "protocol", "results", "cannot_tell", "reporting", "contacts", "group", "cluster", "live", "plugins",
        "../CONTRIBUTING",
    ],
    "Explanation": [
        "c1", "filter", "verdict", "verdict_method", "verdict_fit", "verdict_answer",
        "verdict_campaign", "contacts_method",
        "prediction", "limits", "comparison", "steering_measured", "dissertation",
        "architecture", "decisions", "reliability",
    ],
    "Reference": [
        "faq", "troubleshooting", "glossary", "configuration", "formats", "verdict_json", "contacts_study",
        "json", "api", "gallery", "constants",
        "platforms", "licences", "../CHANGELOG", "../SECURITY",
        "../benchmarks/README", "../benchmarks/steering/README", "../benchmarks/last_run/README",
    ],
    "The integrator": [
        "integrator", "integrator_examples", "integrator_reference", "integrator_many", "integrator_compiled",
        "integrator_choices", "sliding", "known_instants", "gradients",
        "integrator_step", "integrator_proof", "integrator_method", "printed_method",
    ],
}  # fmt: skip

project, author = "hopdata", "The hopdata developers"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "README"
include_patterns = [
    "*.md",
    "docs/*.md",
    "benchmarks/README.md",
    "benchmarks/steering/README.md",
    "benchmarks/last_run/README.md",
]
exclude_patterns = [".*", "src", "tests", "results", "workflow", "data", "dist"]

nb_custom_formats = {".md": ["executed_pages.notebook", {}, False]}
nb_merge_streams = True
nb_execution_mode = "off"  # `docs/run_pages.py` has run them
myst_heading_anchors = 4
myst_enable_extensions = ["deflist", "dollarmath"]

autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_math_renderer = "mathml"
html_title = f"hopdata {release}"
html_copy_source = False
html_show_copyright = False


def _contents(_app, page, source):
    """Put the contents, which GitHub would show as they stand, below the first page."""
    if page == root_doc:
        for title, pages in PAGES.items():
            rows = "\n".join(
                f"/docs/{one}" if one[0] != "." else one[2:] for one in pages
            )
            source[0] += (
                f"\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n{rows}\n```\n"
            )


def _plain_commands(_app, tree):
    """Show commands of the shell as a reader types them, without the notebook's magic."""
    magic = "%%bash -e\n"
    for block in list(tree.findall(literal_block)):
        if block.astext().startswith(magic):
            typed = block.astext().removeprefix(magic)
            block.replace_self(literal_block(typed, typed, language="bash"))


def _first_page(app, failed):
    if not failed:
        to = f'<meta http-equiv="refresh" content="0; url={root_doc}.html">'
        Path(app.outdir, "index.html").write_text(
            f"<!doctype html>{to}\n", encoding="utf-8"
        )


#: A line that a command of the first page prints; a broken one would show a broken
#: page.
WHOLE_LINE = "markers  7: body1, body2, body3, foot1, foot2, foot3, boom"


def _whole_lines(app, failed):
    """Require that what a command printed was not broken into pieces."""
    page = Path(app.outdir, "docs", "first_study.html")
    if failed or not page.exists():
        return
    shown = re.sub("<[^>]*>", "", page.read_text(encoding="utf-8"))
    if WHOLE_LINE not in shown:
        raise RuntimeError(
            f"{page}: expected the line '{WHOLE_LINE}', found it broken or not at all"
        )


def _set_formulae(app, failed):
    """Require that formulae are set, not shown as they are written."""
    page = Path(app.outdir, "docs", "verdict_method.html")
    if not failed and page.exists() and "<math" not in page.read_text("utf-8"):
        raise RuntimeError(f"{page}: expected formulae set as MathML, found none")


def _formula_in_a_line(translator, node):
    """Write a formula as MathML, which browsers set themselves, without a network."""
    translator.body.append(convert(node.astext()))
    raise SkipNode


def _formula_by_itself(translator, node):
    formula = convert(node.astext(), display="block")
    translator.body.append(
        f'<div class="formula" style="padding: 0.4em 0">{formula}</div>\n'
    )
    raise SkipNode


def setup(app):
    """Connect what Sphinx calls."""
    app.add_html_math_renderer(
        "mathml", (_formula_in_a_line, None), (_formula_by_itself, None)
    )
    app.connect("source-read", _contents)
    app.connect("doctree-read", _plain_commands)
    app.connect("build-finished", _first_page)
    app.connect("build-finished", _whole_lines)
    app.connect("build-finished", _set_formulae)
