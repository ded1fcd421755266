import base64
import hashlib
import re
from pathlib import Path

import numpy as np
import pytest
from fake_study import NAMES, NUMBERED, captions, full_study, sections, verdict

from hopdata.errors import ConfigError
from hopdata.recording import Recording
from hopdata.report import inputs as inputs_module
from hopdata.report.inputs import (
    ReportInputs,
    describe_recording,
    render_caption,
    rendered,
)
from hopdata.report.page import build_report, study_facts


def recording(n=5):
    positions = np.zeros((n, 6, 3))
    positions[:1, 0, 2] = np.nan
    names = ("b1", "b2", "b3", "f1", "f2", "boom")
    roles = ("body",) * 3 + ("foot",) * 2 + ("boom",)
    time = np.arange(n) / 100
    return Recording(
        "run", time, positions, names, roles, 100.0, source="some/where/run.tsv"
    )


def test_a_recording_is_described():
    entry = describe_recording(recording())
    assert entry.pop("duration_s") == pytest.approx(0.04)
    assert entry.pop("seen") == pytest.approx(29 / 30)
    assert entry == {
        "name": "run",
        "source": "run.tsv",
        "n_frames": 5,
        "rate_hz": 100.0,
        "n_feet": 2,
        "n_body": 3,
    }


def test_a_recording_without_frames_is_described_too():
    entry = describe_recording(recording(0))
    assert (entry["n_frames"], entry["duration_s"], entry["seen"]) == (0, 0.0, None)


def test_the_description_reaches_the_page():
    page = build_report(ReportInputs("s", recordings=[describe_recording(recording())]))
    for cell in ("run.tsv", "96.67", "0.0"):
        assert f">{cell}<" in page


def test_a_caption_has_title_paragraphs_and_alternative_text():
    text = (
        "# A\u00a0title\n\nOne\nparagraph of {{ n }}.\n\nAnother.\n\nAlt: A\npicture.\n"
    )
    caption = render_caption(text, {"n": 3}, name="fig")
    assert caption.title == "A\u00a0title"
    assert caption.paragraphs == ("One paragraph of 3.", "Another.")
    assert caption.alt == "A picture."


def test_no_line_break_parts_a_number_from_its_per_cent():
    caption = render_caption("# T\n\nFrom 5 to 95 %, a\n%", {}, name="fig")
    assert caption.paragraphs == ("From 5 to 95\u00a0%, a %",)


def test_a_bare_caption_falls_back_on_the_name():
    caption = render_caption("", {}, name="fig9")
    assert (caption.title, caption.paragraphs, caption.alt) == ("fig9", (), "fig9")


@pytest.mark.parametrize("text", ["{{ travvel }}", "{% if %}"])
def test_a_mistake_in_a_caption_is_named(text):
    with pytest.raises(ConfigError, match="caption of fig2"):
        render_caption(text, {"travel": "1 mm"}, name="fig2")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "inputs", [full_study(), ReportInputs("none")], ids=["full", "bare"]
)
def test_the_workflows_captions_can_be_filled_from_any_study(name, inputs):
    caption = render_caption(captions()[name], study_facts(inputs), name=name)
    if name in NUMBERED:
        assert caption.title.startswith(f"Figure {name[3:6].replace('_', '.')}: ")
    assert caption.paragraphs
    assert caption.alt != caption.title
    assert "None" not in " ".join(caption.paragraphs)


def test_sections_from_landings_alone_are_said():
    template = captions()["fig2_2_sections"]
    for frames, said in (("landings", True), ("all", False)):
        facts = study_facts(full_study(sections=sections() | {"frames": frames}))
        text = " ".join(render_caption(template, facts, name="fig2_2").paragraphs)
        assert ("landings alone" in text) is said


def test_one_order_occurs_and_two_occur():
    for n, words in ((1, "1 order occurs"), (2, "2 orders occur")):
        facts = study_facts(full_study()) | {"n_schedules": n}
        text = " ".join(
            render_caption(captions()["fig2_3_schedule"], facts, name="f").paragraphs
        )
        assert f"{words}, and" in text


def test_captions_name_the_numbers_of_the_study():
    facts = study_facts(full_study())
    shown = {name: " ".join(render_caption(captions()[name], facts, name=name).paragraphs)
             for name in NAMES}  # fmt: skip
    assert "211\u00a0mm" in shown["fig2_2_sections"]
    assert (
        f"{facts['n_used']} of {facts['n_landings']} landings"
        in shown["fig2_3_schedule"]
    )
    assert "29.1\u00a0mm and 27\u00a0ms" in shown["fig2_4_prediction"]
    assert "3.10 rad" in shown["fig2_5_distances"]


def test_one_recording_alone_is_named_only_where_there_are_several():
    for n, said in ((1, False), (2, True)):
        facts = study_facts(full_study()) | {"n_recordings": n}
        caption = render_caption(captions()["stability"], facts, name="stability")
        assert ("one recording alone" in caption.paragraphs[0]) is said


def test_the_caption_of_the_verdict_says_what_is_drawn():
    facts = study_facts(full_study())
    paragraphs = render_caption(captions()["verdict"], facts, name="verdict").paragraphs
    assert "rms over landings and markers" in paragraphs[0]
    assert "triangle" not in paragraphs[0]
    assert "(b) The 6 orders in which the feet touched" in paragraphs[1]


def test_the_caption_of_the_verdict_says_what_its_plots_do_not_show():
    told = {
        "contacts_r2": 0.971,
        "main_contrast": "most of all: feet 1 and 2",
        "gross_errors": {"outcome_far_off": [1522], "state_far_off": [3, 1522]},
        "messages": {"outlook": {"values": {"asked": "20 %", "number": "1,100"}}},
    }
    shown = {}
    for name, more in (("more", told), ("plain", {})):
        facts = study_facts(full_study(verdict=verdict(**more)))
        paragraphs = render_caption(captions()["verdict"], facts, name="v").paragraphs
        shown[name] = " ".join(paragraphs).replace("\u00a0", " ")
    assert (
        "Compared: 6 contact orders in 986 landings judged, fitted to the 700 with the "
        "contacts closest together; used, but not judged, since like none of the "
        "others: 2; 97.1 % of their contact order is foretold. Most of all: feet "
        "1 and 2. Landings needed to see 20 %: about 1,100."
    ) in shown["more"]
    assert "with the contacts closest together." in shown["plain"]
    assert "needed" not in shown["plain"]
    assert "(b) The 6 orders in" in shown["plain"]


def test_the_caption_of_own_maps_says_of_which_landings_they_are():
    facts = study_facts(full_study())
    shown = render_caption(captions()["one_or_own"], facts, name="one_or_own")
    text = " ".join(shown.paragraphs)
    assert "in the order 2 → 1 → 3" in text
    assert "over 621 landings, each foretold from others; 6 orders" in text


def test_the_caption_of_the_maps_gives_their_errors():
    errors = {
        "map_estimate_error_printed": 0.133,
        "map_estimate_error_corrected_curved": 0.038,
    }
    truth = {
        name: {"value": value, "unit": "1", "what": ""}
        for name, value in errors.items()
    }
    shown = {}
    for name, known in (("simulated", truth), ("real", {})):
        facts = study_facts(ReportInputs("study", truth=known))
        caption = render_caption(captions()["map_matrices"], facts, name="map_matrices")
        shown[name] = " ".join(caption.paragraphs)
    assert (
        "printed map has a relative error of 0.13, the corrected one of 0.04"
        in shown["simulated"]
    )
    assert "exact" not in shown["real"]
    assert "A map of zeros errs less" not in shown["simulated"]

    truth["map_estimate_error_printed"]["value"] = 1.02
    facts = study_facts(ReportInputs("study", truth=truth))
    caption = render_caption(captions()["map_matrices"], facts, name="map_matrices")
    assert "A map of zeros errs less" in " ".join(caption.paragraphs)


def test_the_caption_of_the_scaling_study_gives_its_slopes():
    slopes = {"scaling_slope_hopper": 1.947, "scaling_slope_delay": 1.2, "other": 3.0}
    truth = {
        name: {"value": value, "unit": "1", "what": ""}
        for name, value in slopes.items()
    }
    facts = study_facts(ReportInputs("study", truth=truth))
    caption = render_caption(captions()["scaling_study"], facts, name="scaling_study")
    assert "Over all scales: hopper 1.95, delay 1.20." in " ".join(caption.paragraphs)


# The policy of pages.

PACKAGE = Path(inputs_module.__file__).parents[1]


def policy_of(page):
    (found,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', page)
    return dict(part.split(" ", 1) for part in found.split("; "))


def test_a_page_allows_its_own_scripts_and_styles_and_nothing_else():
    page = build_report(full_study())
    policy = policy_of(page)
    assert policy["default-src"] == "'none'"
    assert policy["img-src"] == "data:"
    nonce = re.fullmatch(r"'nonce-(\w{32})'", policy["script-src"])[1]
    assert "unsafe-inline" not in str(policy)
    # Every script that runs and every style bears the nonce.
    texts = re.sub(rf'(<script nonce="{nonce}">).*?</script>', r"\1", page, flags=re.S)
    tags = re.findall(r"<(?:script|style)[^>]*>", texts)
    assert len(tags) >= 2
    bare = [one for one in tags if nonce not in one]
    assert bare == ['<script type="application/json">'] * len(bare)
    # Every style that is an attribute is allowed by its digest.
    for style in re.findall(r'\sstyle="([^"]*)"', texts):
        digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy["style-src"]
    assert not re.search(r"<[^>]*\son\w+=", page)  # a handler of an event
    # It comes before all that it is to hold back.
    assert page.index("Content-Security-Policy") < page.index("<style")


def test_the_same_content_has_the_same_page_and_another_another_nonce():
    one = build_report(full_study())
    assert one == build_report(full_study())
    other = build_report(full_study(study="other"))
    assert policy_of(one)["script-src"] != policy_of(other)["script-src"]


def test_names_reach_no_page_as_html_or_as_what_turns_it():
    page = build_report(full_study(study="a<script>b</script>\u202ec\x1bd 左"))
    assert "a&lt;script&gt;b&lt;/script&gt;?c?d 左" in page
    assert "\u202e" not in page


@pytest.mark.parametrize(
    "template", sorted(PACKAGE.rglob("templates/*.html.j2")), ids=lambda path: path.name
)
def test_every_template_that_is_a_page_can_bear_a_policy(template):
    text = template.read_text(encoding="utf-8")
    if "<html" not in text:
        assert "<script>" not in text
        return
    assert text.count(inputs_module.CHARSET) == 1
    assert "<script>" not in text
    assert "<style>" not in text
    assert not re.search(r"<[^>]*\son\w+=", text)
    styles = re.findall(r'\sstyle="([^"]*)"', text)
    assert all(re.fullmatch(r"--paper: \{\{ .* \}\}pt", style) for style in styles)


def test_a_page_that_cannot_bear_a_policy_is_no_page(tmp_path):
    (tmp_path / "bare.html.j2").write_text("<html><head></head></html>")
    with pytest.raises(ValueError, match="for the policy"):
        rendered("bare.html.j2", own=tmp_path)
