"""Every page in a browser, all at once: accessible, as wide as its window, nothing cut."""

import html
import io
import json
import re
import subprocess
from types import SimpleNamespace

import pytest
from fake_steering import full_steering
from made_up_hopper import MARKERS, hopping, with_spike
from test_browser import CHROMIUM, LISTEN, QUIET, axe, two_panels

from hopdata.bundled import SNAKEFILE
from hopdata.commands.contacts_page import contacts_html
from hopdata.commands.inspect import inspection_html
from hopdata.contact_times import contacts
from hopdata.figures import style
from hopdata.figures.verdict import group_figure
from hopdata.group import contacts_of, put_together
from hopdata.recordings.quality.inspection import inspect_recording
from hopdata.recordings.raw import RawRecording
from hopdata.report.group_page import build_group_page
from hopdata.report.inputs import ReportFigure, picture_of, rendered
from hopdata.report.scene import recording_scene
from hopdata.steering.report.page import build_steering_report
from test_group import GROUP, landed, made_up, undecided

#: A path that has no place to break.
LONG_NOTE = f"/recordings/{'long' * 20}.txt: time stamps run evenly"
ASK = """<script>
addEventListener("load", async () => {
  document.querySelectorAll("details").forEach((fold) => (fold.open = true));
  const found = { told, width: innerWidth, wide: document.documentElement.scrollWidth,
    cut: [...document.querySelectorAll(".picture")].filter((one) => one.scrollWidth > one.clientWidth + 1).length,
    scrolled: [...document.querySelectorAll(".table")].filter((one) => one.scrollWidth > one.clientWidth + 1)
      .map((one) => one.getAttribute("aria-label")),
    scale: Math.min(...[...document.querySelectorAll(".picture img[src*=svg]")].map((one) =>
      0.75 * one.clientWidth / parseFloat(one.style.getPropertyValue("--paper")))),
    dark: getComputedStyle(document.body).backgroundColor };
  const buttons = document.querySelectorAll("#leave-out button");
  if (buttons.length) buttons[0].click();
  found.lines = document.querySelector("#leave-out pre")?.textContent;
  found.violations = (await axe.run()).violations.map((one) =>
    `${one.id}: ${one.nodes.map((node) => node.html.slice(0, 120)).join(" | ")}`);
  await new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(go)));
  found.idle_stops = [...document.querySelectorAll(".picture, .table, pre")].filter((one) =>
    one.tabIndex === 0 && one.scrollWidth <= one.clientWidth + 1).length;
  const first = document.querySelector("a, button, summary, input, [tabindex='0']");
  first.focus();
  found.skips_to = document.querySelector(first.hash || "none")?.tagName;
  found.first_seen = first.getBoundingClientRect().left >= 0;
  document.documentElement.dataset.found = JSON.stringify(found);
});
</script>"""


def group_page(number, **options):
    rows = [one | {"contacts": contacts_of(landed())} for one in made_up(number)]
    group = put_together(rows, GROUP)
    caption = (SNAKEFILE.parent / "workflow/captions/group.md").read_text("utf-8")
    drawn = io.BytesIO()
    with style.style_context():
        group_figure(group).savefig(drawn, format="svg")
    figure = ReportFigure("group", drawn.getvalue(), "image/svg+xml", caption)
    return build_group_page(group, [figure], **options)


@pytest.fixture(scope="module")
def pages():
    time, positions = hopping(1)
    faulty = with_spike(positions, "hip2", 400, 0.06)
    inspection = inspect_recording(
        RawRecording(tuple(MARKERS), time, faulty, rate_hz=100.0, unit="m")
    )
    recording = inspection.recording(MARKERS[3:6], MARKERS[:3], name="monday")
    found = contacts([recording.part(slice(600))])
    first = picture_of(ReportFigure("a", two_panels(), "image/svg+xml", "# A"), {})
    scene = recording_scene(recording.part(slice(200)))
    return {
        "inspect": inspection_html(inspection, "monday.tsv"),
        "contacts": contacts_html(found, title="monday", notes=[LONG_NOTE]),
        "view": rendered("view.html.j2", title="monday", told="7", scene=scene),
        "first look": rendered("first_look.html.j2", pictures=[first]),
        "group": group_page(12),
        "undecided": build_group_page(put_together([undecided("a")], GROUP), []),
        "large group": group_page(30, one_by_one=False),
        "steering": build_steering_report(full_steering()),
    }


def framed(page, name, width):
    """Return a page as a frame that asks it for what a reader meets."""
    nonce = re.search(r"script-src 'nonce-(\w+)'", page)[1]
    ours = f'<script nonce="{nonce}">'
    asking = "".join(part.replace("<script>", ours, 1) for part in (axe(), ASK))
    asked = page.replace("<head>", "<head>" + LISTEN, 1).replace(
        "</body>", asking + "</body>"
    )
    return (
        f'<iframe title="{name}" style="border:0" width="{width}" height="900" '
        f'srcdoc="{html.escape(asked)}"></iframe>'
    )


COLLECT = """<script>
const ask = () => {
  const frames = [...document.querySelectorAll("iframe")];
  const found = frames.map((one) => one.contentDocument.documentElement.dataset.found);
  if (!found.every(Boolean)) return setTimeout(ask, 200);
  const named = frames.map((one, i) => [one.title, JSON.parse(found[i])]);
  document.body.dataset.found = JSON.stringify(Object.fromEntries(named));
};
addEventListener("load", ask);
</script>"""


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium")
@pytest.mark.parametrize(("width", "dark"), [(1200, False), (500, True)])
def test_every_page_in_a_browser(pages, width, dark, tmp_path):
    frames = "".join(framed(page, name, width) for name, page in pages.items())
    file = tmp_path / "frames.html"
    file.write_text(f"<body>{frames}{COLLECT}</body>", encoding="utf-8")
    scheme = ["--blink-settings=preferredColorScheme=0"] if dark else []
    home = f"--user-data-dir={tmp_path / 'browser'}"
    command = [CHROMIUM, *QUIET, *scheme, home, "--virtual-time-budget=60000"]
    dump = subprocess.run(
        [*command, "--dump-dom", file.as_uri()],
        capture_output=True, text=True, timeout=180, check=True,
    ).stdout  # fmt: skip
    told = json.loads(html.unescape(re.search(r'<body data-found="(.*?)"', dump)[1]))
    assert {*told} == {*pages}
    for name, found in told.items():
        found = SimpleNamespace(**found)
        assert found.violations == [], name
        assert found.told == [], name
        assert found.width == width
        assert found.wide <= width, f"{name} is wider than its window"
        assert found.cut == 0, f"{name}: a figure is cut"
        assert found.scrolled == [], f"{name}: a table is cut"
        # Letters of 7 points are not smaller than 5.6, or 7.5 pixels.
        assert found.scale is None or found.scale > 0.78, f"{name}: letters shrink"
        if "<script" in pages[name]:  # without one, every block is a stop
            said = f"{name}: the tab key stops where nothing scrolls"
            assert found.idle_stops == 0, said
        assert found.skips_to == "MAIN", f"{name} has no link to its content first"
        assert found.first_seen, f"{name}: that link is not seen when it has the focus"
        assert (sum(map(int, re.findall(r"\d+", found.dark)[:3])) < 200) == dark
    assert "exclude:\n      - {from_s: 0.000, to_s: " in told["inspect"]["lines"]
