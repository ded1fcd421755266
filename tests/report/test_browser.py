"""The page in a browser: no console output, no overflow, rotatable, readable."""

import html
import io
import json
import os
import re
import shutil
import subprocess
from importlib.resources import files
from pathlib import Path

import pytest
from fake_study import figures, full_study
from test_scene import falling, landings

from hopdata.figures import style
from hopdata.report.page import build_report

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
QUIET = [
    f"--{option}"
    for option in (
        "headless",
        "no-sandbox",
        "disable-gpu",
        "disable-quic",
        "no-first-run",
        "disable-sync",
        "disable-background-networking",
        "disable-component-update",
    )
]
#: Added to the page before everything else, and read at the end.
LISTEN = """<script>
const told = [];
for (const kind of ["error", "warn"]) console[kind] = (...words) => told.push(words.join(" "));
addEventListener("error", (event) => told.push(event.message));
document.addEventListener("securitypolicyviolation", (event) =>
  told.push(`${event.violatedDirective}: ${event.sample || event.blockedURI}`));
</script>"""
ASK = """<script>
addEventListener("load", async () => {
  document.querySelectorAll("details").forEach((fold) => (fold.open = true));
  const canvas = document.querySelector(".scene canvas");
  const pictures = [...document.querySelectorAll(".picture")];
  const pixels = () => canvas.toDataURL();
  const before = pixels();
  canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" }));
  const found = { told, turned: before !== pixels(), width: innerWidth,
    wide: document.documentElement.scrollWidth,
    panels: pictures.map((one) => one.querySelectorAll("img").length),
    scrolled: pictures.some((one) => one.scrollWidth > one.clientWidth),
    tables: [...document.querySelectorAll(".table")].filter((one) => one.scrollWidth > one.clientWidth + 1)
      .map((one) => one.getAttribute("aria-label")),
    dark: getComputedStyle(document.body).backgroundColor };
  found.violations = (await axe.run()).violations.map((one) =>
    `${one.id}: ${one.nodes.map((node) => node.html.slice(0, 120)).join(" | ")}`);
  document.documentElement.dataset.found = JSON.stringify(found);
});
</script>"""


def axe():
    """Return axe-core's script from the file that AXE names or from its package."""
    place = os.environ.get("AXE") or files("axe_core_python").joinpath("axe.min.js")
    return f"<script>{Path(str(place)).read_text(encoding='utf-8')}</script>"


def two_panels():
    """Draw two axes side by side, a line that leaves them, and a legend below, in every figure."""
    drawn = io.BytesIO()
    with style.style_context():
        figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 60.0)
        for axes in figure.subplots(1, 2):
            axes.plot([0, 50], [0, 50], label="fitted")
            axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="before", ylabel="after")
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center")
        figure.savefig(drawn, format="svg")
    return drawn.getvalue()


def seen(page, folder, *options, width=1280, ask=ASK):
    """Return what a browser finds on a page, in a frame of this width."""
    nonce = re.search(r"script-src 'nonce-(\w+)'", page)[1]
    parts = [axe(), ask]
    ours = f'<script nonce="{nonce}">'
    asking = "".join(part.replace("<script>", ours, 1) for part in parts)
    asked = page.replace("<head>", "<head>" + LISTEN, 1).replace(
        "</body>", asking + "</body>"
    )
    frame = folder / "framed.html"
    frame.write_text(
        f'<body style="margin:0"><iframe style="border:0" width="{width}" height="900" '
        f'srcdoc="{html.escape(asked)}" onload="setTimeout(() => document.body.dataset.found = '
        'this.contentDocument.documentElement.dataset.found, 9000)"></iframe>',
        encoding="utf-8",
    )
    home = f"--user-data-dir={folder / 'browser'}"
    budget = "--virtual-time-budget=20000"
    command = [CHROMIUM, *QUIET, *options, home, budget, "--dump-dom", frame.as_uri()]
    dump = subprocess.run(
        command, capture_output=True, text=True, timeout=120, check=True
    ).stdout
    return json.loads(
        html.unescape(re.search(r'<body[^>]*data-found="(.*?)"', dump)[1])
    )


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium")
@pytest.mark.parametrize(("width", "dark"), [(1280, False), (390, True)])
def test_the_page_in_a_browser(width, dark, tmp_path):
    scheme = ["--blink-settings=preferredColorScheme=0"] if dark else []
    pictures = figures(two_panels())
    study = full_study(levelled=[falling()], touchdowns=landings(), figures=pictures)
    found = seen(build_report(study), tmp_path, *scheme, width=width)
    assert found["told"] == []
    assert found["turned"], "the landing in 3-D did not move"
    assert found["width"] == width
    assert found["wide"] <= width, "the page is wider than its window"
    assert (sum(map(int, re.findall(r"\d+", found["dark"])[:3])) < 200) == dark
    assert found["violations"] == []
    # In the narrow window, two panels and their legend are stacked.
    assert set(found["panels"]) == {3 if width < 700 else 1}
    assert not found["scrolled"]
    assert found["tables"] == []


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium")
def test_what_a_template_did_not_write_is_not_run(tmp_path):
    """As if a name had reached the page as HTML."""
    foreign = '<script>console.error("ran")</script>'
    foreign += (
        '<img alt="" src="x" onerror="console.error(this)"><p style="color: red">'
    )
    study = full_study(levelled=[falling()], touchdowns=landings(), figures=figures())
    main = '<main id="content" tabindex="-1">'
    page = build_report(study).replace(main, main + foreign)
    told = seen(page, tmp_path)["told"]
    blocked = {one.split(":")[0] for one in told}
    assert blocked == {
        "script-src-elem",
        "script-src-attr",
        "style-src-attr",
        "img-src",
    }
