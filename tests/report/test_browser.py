"""The page in a browser: silent on its console, no wider than its window, turned, readable."""

import html
import json
import os
import re
import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path

import pytest
from fake_study import full_study
from test_scene import falling, landings

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
#: Told to the page before all else, and asked of it at last.
LISTEN = """<script>
const told = [];
for (const kind of ["error", "warn"]) console[kind] = (...words) => told.push(words.join(" "));
addEventListener("error", (event) => told.push(event.message));
</script>"""
ASK = """<script>
addEventListener("load", async () => {
  document.querySelectorAll("details").forEach((fold) => (fold.open = true));
  const canvas = document.querySelector(".scene canvas");
  const pixels = () => canvas.toDataURL();
  const before = pixels();
  canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" }));
  const found = { told, turned: before !== pixels(), width: innerWidth,
    wide: document.documentElement.scrollWidth,
    dark: getComputedStyle(document.body).backgroundColor };
  if (window.axe) found.violations = (await axe.run()).violations.map((one) =>
    `${one.id}: ${one.nodes.map((node) => node.html.slice(0, 120)).join(" | ")}`);
  document.documentElement.dataset.found = JSON.stringify(found);
});
</script>"""


def axe():
    """Return axe-core's script, of the file that AXE names or of a package that has it."""
    place = os.environ.get("AXE")
    if not place and (package := find_spec("axe_playwright_python")):
        place = next(iter(Path(package.submodule_search_locations[0]).rglob("axe.min.js")), None)
    return f"<script>{Path(place).read_text(encoding='utf-8')}</script>" if place else ""


def seen(page, folder, *options, width=1280):
    """Return what a browser found of a page, in a frame of this width."""
    asked = page.replace("<head>", "<head>" + LISTEN, 1).replace("</body>", axe() + ASK + "</body>")
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
    dump = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    return json.loads(html.unescape(re.search(r'<body[^>]*data-found="(.*?)"', dump)[1]))


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium")
@pytest.mark.parametrize(("width", "dark"), [(1280, False), (390, True)])
def test_the_page_in_a_browser(width, dark, tmp_path):
    scheme = ["--blink-settings=preferredColorScheme=0"] if dark else []
    study = full_study(levelled=[falling()], touchdowns=landings())
    found = seen(build_report(study), tmp_path, *scheme, width=width)
    assert found["told"] == []
    assert found["turned"], "the landing in 3-D did not move"
    assert found["width"] == width
    assert found["wide"] <= width, "the page is wider than its window"
    assert (sum(map(int, re.findall(r"\d+", found["dark"])[:3])) < 200) == dark
    assert found.get("violations", []) == []
