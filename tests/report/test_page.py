import base64
import re
from html.parser import HTMLParser

import pandas as pd
import pytest
from fake_study import (
    CAPTIONS,
    NAMES,
    SVG,
    captions,
    faults,
    figures,
    floors,
    full_study,
    prediction,
    printed_study,
    remarks,
    sections,
    touchdowns,
    truth,
)

from hopdata.errors import ConfigError
from hopdata.landings.checks import check_study
from hopdata.landings.touchdowns import NO_FOOT_LANDED
from hopdata.report.inputs import (
    ReportFigure,
    ReportInputs,
    read_figures,
    render_caption,
)
from hopdata.report.page import PRINTED_CLAIMS, build_report, study_facts
from hopdata.report.tables import quality_summary

SHOWN = [name for name in NAMES if name not in PRINTED_CLAIMS]
VOID = {"meta", "img", "br", "link", "hr", "input"}
DOCUMENTS = "https://github.com/hopdata/hopdata/blob/v"
LOADING = {"src", "href", "srcset", "action", "data", "poster"}


class Page(HTMLParser):
    """Structure of a page: balanced tags, attributes, headings, table captions."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.open, self.headings, self.captions, self.links = [], [], [], []
        self.images, self.ids, self.words, self.unbalanced = [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.ids += [given["id"]] if "id" in given else []
        self.links += [given[name] for name in LOADING & given.keys()]
        if tag == "img":
            self.images.append(given)
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.unbalanced.append(tag)

    def handle_data(self, data):
        if "style" not in self.open:
            self.words.append(data)
        if self.open[-1:] == ["caption"]:
            self.captions.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def full():
    return Page(build_report(full_study()))


@pytest.fixture(scope="module")
def bare():
    return Page(build_report(ReportInputs("bare")))


@pytest.mark.parametrize("which", ["full", "bare"])
def test_the_page_is_well_formed(which, request):
    page = request.getfixturevalue(which)
    assert page.unbalanced == []
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    assert page.headings[0] == 1
    assert set(page.headings[1:]) == {2}


@pytest.mark.parametrize("which", ["full", "bare"])
def test_nothing_is_loaded_from_elsewhere(which, request):
    page = request.getfixturevalue(which)
    for link in page.links:
        # The documentation is opened by a click alone.
        assert link.startswith(("data:", "#", DOCUMENTS))
        assert not link.startswith("#") or link[1:] in page.ids
    text = build_report(full_study()).replace(f'<a href="{DOCUMENTS}', "")
    assert "http://" not in text
    assert "https://" not in text
    assert "@import" not in text
    assert "url(" not in text
    assert "<script src" not in text


def test_the_language_and_the_title_are_given():
    text = build_report(full_study())
    assert text.startswith('<!DOCTYPE html>\n<html lang="en">')
    assert "<title>sample: " in text


def test_the_caption_of_the_first_figure_can_be_opened():
    text = build_report(full_study())
    opened = text.partition("<summary>Caption of this figure</summary>")[2]
    assert "Compared: 6 contact orders" in opened.partition("</details>")[0]


def test_every_table_is_there(full):
    assert full.captions == [
        "Which contact orders differ",
        "So what? One landing, by one map and by its order's own",
        "Can these data be trusted?",
        "Faults of the recordings",
        "Remarks on the recordings",
        "Why descents are not used",
        "Every landing that is not used",
        "Recordings",
        "Floor",
        "Thresholds and sections",
        "Used touchdowns by mode schedule",
        "Estimates and truth",
        "Run",
        "Inputs",
        "Versions",
        "Time per job",
    ]


def test_the_quality_is_seen_at_a_glance(full):
    text = full.text.replace("\u202f", " ").replace("\u00a0", " ")
    assert "1 of 3 good" in text
    assert "look: frames seen, worst marker" in text
    for words in (
        "◐ look",
        "97.2 %",
        "≥ 99 %",
        "< 95 %",
        "● good",
        "– not known",
        "61.0 mm",
    ):
        assert words in text


def test_the_worst_checks_are_named_first():
    statuses = ("not known", "look", "good", "poor")
    checks = [{"what": w, "status": s} for w, s in zip("abcd", statuses, strict=True)]
    value, remark = quality_summary(checks)
    assert value == "1 of 4 good, 1 poor"
    assert remark == "poor: d; look: b; not known: a"


def test_long_lists_of_faults_and_exclusions_end_with_how_many_more():
    text = Page(build_report(full_study(faults=faults(50), remarks=remarks(40)))).text
    assert "20 more in tables/faults.csv" in text
    assert "10 more in tables/remarks.csv" in text
    assert text.count("a.trc: unit: taken for mm") == 30


def test_without_remarks_that_is_said():
    assert (
        "no remarks on files and markers"
        in Page(build_report(full_study(remarks=remarks(0)))).text
    )


def test_the_figures_are_inside_and_described(full):
    assert len(full.images) == len(SHOWN)
    for image in full.images:
        kind, data = image["src"].split(",")
        assert kind == "data:image/svg+xml;base64"
        assert base64.b64decode(data) == SVG
        assert len(image["alt"]) > 40
        assert image["style"] == "--paper: 240.9pt"
    for number in ("2.2", "2.3"):
        assert f"Figure {number}: " in full.text


def test_gaps_and_faults_are_drawn_only_where_there_are_any():
    whole = [full_study().recordings[0] | {"seen": 1.0}]
    none = Page(build_report(full_study(recordings=whole, faults=faults().iloc[:0])))
    assert len(none.images) == len(SHOWN) - 1
    assert "Every marker was seen in every frame" in none.text
    for changes in ({"recordings": whole}, {"faults": faults().iloc[:0]}):
        page = Page(build_report(full_study(**changes)))
        assert len(page.images) == len(SHOWN)
        assert "Every marker was seen in every frame" not in page.text


def test_simulated_recordings_are_said_to_be_simulated(full, bare):
    said = "The recordings are simulated"
    assert said in full.text[: full.text.index("At a glance")]
    assert said not in bare.text
    assert said not in Page(build_report(full_study(truth={}))).text


def test_key_numbers_open_the_page(full):
    opening = full.text[: full.text.index("What could not be done")]
    for fact in (
        "29.1 mm and 27 ms",
        "211 mm",
        "97.9 %",
        "of 431 landings",
        "29 440 frames",
    ):
        assert fact in opening.replace("\u202f", " ").replace("\u00a0", " ")


def test_a_single_landing_is_one_landing():
    page = Page(build_report(full_study(touchdowns=touchdowns().head(1))))
    assert "of 1 landing, " in page.text


@pytest.mark.parametrize(
    ("models", "shown"),
    [
        (
            ("specialised", "specialised_mean", "all", "mean"),
            "0.13 ratio of median MSE, both spec",
        ),
        (("all", "mean"), "0.11 ratio of median MSE, both unspec"),
        (("mean",), "not known"),
    ],
)
def test_the_gain_is_that_of_the_models_that_were_fitted(models, shown):
    table = prediction()
    text = Page(
        build_report(printed_study(prediction=table[table["model"].isin(models)]))
    ).text
    assert f"Affine model over mean {shown}" in text


def test_only_a_study_by_the_printed_methods_has_the_printed_claims(full):
    claims = {"Prediction errors", "Arc-length distances"}
    figures = ("Figure 2.4", "Figure 2.5")
    printed = Page(build_report(printed_study()))
    assert claims <= {*printed.captions}
    assert {"prediction", "distances"} <= {*printed.ids}
    assert all(words in printed.text for words in figures)
    assert not claims & {*full.captions}
    assert not {"prediction", "distances", "word-affine", "word-one"} & {*full.ids}
    assert not any(words in full.text for words in (*figures, "Affine model over"))
    assert "map" in full.ids


def test_printed_claims_that_are_missing_are_said_in_words():
    record = printed_study().provenance
    text = Page(build_report(ReportInputs("s", provenance=record))).text
    assert "No distances: no mode schedule holds enough touchdowns" in text
    assert "No model could be fitted" in text


def test_notes_and_provenance_are_shown(full):
    for words in (
        "splits of 52/18 instead of 120/41: class 1>2>3 has 70",
        "9f86d081884c7d659a2feaa0c55ad015",
        "Linux x86_64",
        "level_hopper",
        "degree: 3",
        "20261121",
    ):
        assert words in full.text


def test_what_is_missing_is_said_in_words(bare):
    assert bare.captions == []
    for words in (
        "No landing is used",
        "No sections were chosen",
        "The configuration was not recorded",
        "not known",
    ):
        assert words in bare.text
    assert not re.search(r"\b(None|nan)\b", bare.text)
    assert "Accuracy against the truth" not in bare.text  # nothing was simulated


def test_a_lower_floor_degree_is_among_what_could_not_be_done():
    lower = {
        "a": floors()["hopper"] | {"degree": 1, "note": "feet cover little ground"}
    }
    text = Page(build_report(full_study(floors=lower))).text
    assert "floor of a: degree 1 instead of 3 (feet cover little ground)" in text
    assert "instead of 3" not in Page(build_report(full_study())).text


@pytest.mark.parametrize("printed", [True, False])
def test_a_study_by_the_printed_methods_says_so_before_its_results(printed):
    inputs = full_study(provenance={"config": {"printed": printed}})
    header = build_report(inputs).partition("</header>")[0]
    assert ("methods that the dissertation prints" in header) == printed


def test_names_from_the_user_are_escaped():
    nasty = "<script>alert('&')</script>"
    inputs = full_study(
        study=nasty,
        recordings=[{"name": nasty, "source": nasty}],
        touchdowns=touchdowns(recordings=(nasty, "b")),
        floors=floors((nasty,)),
        notes=[nasty, {"what": nasty, "reason": nasty}],
        truth={nasty: {"value": 1.0, "unit": nasty, "what": nasty}},
        provenance={"inputs": {nasty: nasty}, "config": {nasty: nasty}},
        figures=[
            ReportFigure(
                nasty, SVG, "image/svg+xml", '# {{ study }}\n\nAlt: "{{ study }}'
            )
        ],
    )
    text = build_report(inputs)
    assert "<script>alert" not in text
    page = Page(text)
    assert page.unbalanced == page.open == []
    assert page.images[0]["alt"] == f'"{nasty}'


def test_a_figure_of_another_name_stands_at_the_end():
    extra = ReportFigure("fig9", SVG, "image/svg+xml", "# Another\n\nText.")
    page = Page(build_report(full_study(figures=[*figures(), extra])))
    assert len(page.images) == len(SHOWN) + 1
    assert "others" in page.ids
    assert "More figures" in page.text


def test_a_mistaken_caption_stops_the_report():
    wrong = ReportFigure("fig9", SVG, "image/svg+xml", "{{ wrong }}")
    with pytest.raises(ConfigError, match="fig9"):
        build_report(full_study(figures=[wrong]))


def test_the_same_study_gives_the_same_page():
    assert build_report(full_study()) == build_report(full_study())


def test_figures_are_read_with_their_captions(tmp_path):
    for name in ("b.png", "b.svg", "a.png", "c.pdf"):
        (tmp_path / name).write_bytes(name.encode())
    (tmp_path / "a.md").write_text("# A")
    paths = [tmp_path / name for name in ("b.png", "b.svg", "a.png", "c.pdf")]
    read = read_figures(paths, [tmp_path / "a.md"])
    assert [(f.name, f.image, f.media_type, f.caption) for f in read] == [
        ("b", b"b.svg", "image/svg+xml", ""),
        ("a", b"a.png", "image/png", "# A"),
        ("c", b"", "", ""),
    ]
    page = Page(build_report(ReportInputs("s", figures=read)))
    assert len(page.images) == 2
    assert "not made in a format that a page can show" in page.text


def test_every_placed_figure_has_a_caption_file():
    from hopdata.report.page import PLACES

    assert PLACES
    lacking = [name for name in PLACES if not (CAPTIONS / f"{name}.md").is_file()]
    assert not lacking, f"no caption in workflow/captions: {lacking}"


@pytest.mark.parametrize("scale", [1e-9, 1e7])
def test_the_gain_does_not_depend_on_the_units(scale):
    table = prediction()
    table["median_mse"] *= scale
    text = Page(build_report(printed_study(prediction=table))).text
    assert "Affine model over mean 0.13 ratio of median MSE" in text


def test_counts_are_those_of_the_table():
    table = touchdowns(recordings=("a", "b"))
    facts = study_facts(ReportInputs("s", touchdowns=table))
    assert facts["n_descents"] == facts["n_landings"] == 431
    assert facts["n_excluded"] == table["excluded"].sum()
    assert facts["n_used"] + facts["n_excluded"] == 431
    assert facts["n_schedules"] == 6
    assert facts["n_recordings"] == 2


def test_descents_in_which_no_foot_lands_are_no_landings():
    table = touchdowns(20).assign(excluded=[True] * 9 + [False] * 11)
    table["reason"] = [NO_FOOT_LANDED] * 6 + ["poor fit of foot 1"] * 3 + [""] * 11
    facts = study_facts(ReportInputs("s", touchdowns=table))
    names = ("n_descents", "n_landings", "n_not_landed", "n_used", "n_excluded")
    assert [facts[name] for name in names] == [20, 14, 6, 11, 3]
    page = build_report(ReportInputs("s", touchdowns=table))
    said = "of 14 landings, 3 excluded; no foot of the study landed in 6 of 20 descents"
    assert said in page
    checks = check_study(
        pd.DataFrame({"role": [], "longest_s": [], "noise_m": []}), pd.DataFrame({"kind": []}),
        table.assign(contact_f1_s=table["t_pre_s"] + 0.02), pd.DataFrame({"pre_height_m": [1.0], "post_height_m": [0.9], "note": [""]}),
        pd.DataFrame({name: [] for name in ("median_of_part", "typical", "se")}), other_feet=True,
    )  # fmt: skip
    used = next(check for check in checks if check.what == "touchdowns used")
    assert used.remark.startswith("11 of 14 landings; ")
    assert used.remark.endswith("; not counted: 6 more descents, of other feet")


@pytest.mark.parametrize("yes", ["True", "true", 1])
def test_booleans_that_csv_made_text_are_understood(yes):
    table = touchdowns(20).assign(excluded=[yes] * 5 + ["False"] * 15)
    assert study_facts(ReportInputs("s", touchdowns=table))["n_excluded"] == 5


def test_texts_with_units():
    facts = study_facts(full_study())
    assert facts["units"] == "29.1\u00a0mm and 27\u00a0ms"
    assert facts["travel"] == "211\u00a0mm"
    assert facts["labels_right"] == {
        "kink": ("97.9\u00a0%", "95.1\u00a0%"),
        "velocity minimum": ("94.9\u00a0%", None),
    }
    assert facts["not_fitted"] == ""


def test_models_that_are_missing_are_listed():
    table = prediction()
    table.loc[table["model"] == "near", "median_mse"] = None
    facts = study_facts(
        ReportInputs("s", prediction=table[table["model"] != "specialised"])
    )
    assert facts["not_fitted"] == "affine (specialised) and affine (near)"
    assert facts["medians"]["near"] is None


def test_nothing_known_gives_the_same_keys():
    bare = study_facts(ReportInputs("s"))
    assert bare.keys() == study_facts(full_study()).keys()
    assert bare["travel"] is bare["units"] is bare["n_used"] is bare["spread"] is None
    empty = study_facts(ReportInputs("s", touchdowns=touchdowns(5).iloc[:0]))
    assert (empty["n_descents"], empty["spread"]) == (0, None)


def test_a_share_that_could_not_be_computed_is_left_out():
    entries = truth()
    entries["labels_right_kink"]["value"] = None
    assert "kink" not in study_facts(ReportInputs("s", truth=entries))["labels_right"]


def test_tables_without_rows_or_optional_columns():
    lean = prediction()[["model", "median_mse"]]
    facts = study_facts(ReportInputs("s", prediction=lean, distances=pd.DataFrame(
        {"kind": [], "median_distance": []})))  # fmt: skip
    assert set(facts["distances"].values()) == {None}


def test_the_caption_says_which_rule_chose_and_what_it_holds():
    facts = study_facts(ReportInputs(study="x", sections=sections()))
    assert (facts["pre_held"], facts["post_held"]) == ("100\u00a0%", "97\u00a0%")
    assert not facts["printed_rule"]
    assert "308" in facts["beside_post"]
    template = captions()["fig2_2_sections"]
    said = {}
    for name, changed in (
        ("landings", {}),
        ("printed", {"rule": "printed"}),
        ("given", {"chosen_by": {"pre_height_m": "config", "post_height_m": "config"}}),
    ):
        inputs = full_study(sections=sections() | changed)
        caption = render_caption(template, study_facts(inputs), name="fig2_2")
        said[name] = " ".join(caption.paragraphs)
    assert "chosen from the landings" in said["landings"]
    assert "chosen by the printed rule" in said["printed"]
    assert "The configuration sets both" in said["given"]
    for name, text in said.items():
        assert ("chosen from the landings" in text) == (name == "landings")
        assert ("chosen by the printed rule" in text) == (name == "printed")
        assert "pre section 100\u00a0% of the landings" in text
        assert "the post section 97\u00a0%." in text


def test_the_page_shows_what_the_study_sets_or_all_keys_if_that_is_not_known():
    lines = build_report(full_study(settings={"study": "sample"}))
    assert "what this study sets" in lines
    assert "degree: 3" not in lines
    whole = build_report(full_study())
    assert "degree: 3" in whole
    assert "what this study sets" not in whole


def test_the_truth_about_figures_that_are_not_shown_is_not_shown():
    assert "Whether near &lt; all &lt; far" not in build_report(full_study())
    assert "Whether near &lt; all &lt; far" in build_report(printed_study())
