"""The methods paragraph: a study's own numbers, and references that exist."""

import re

from fake_study import full_study, verdict
from test_page import Page

from hopdata.report.methods import CITED, methods
from hopdata.report.page import build_report, study_facts


def of(inputs):
    facts = study_facts(inputs)
    return methods(facts, inputs.verdict, inputs.recordings, inputs.provenance)


def test_it_says_the_numbers_of_the_study_but_no_result():
    inputs = full_study()
    text = of(inputs).text
    facts = study_facts(inputs)
    for number in (facts["n_used"], facts["n_landings"], verdict()["n_landings"]):
        assert f"{number:,}" in text
    assert verdict()["sentence"] not in text, "it is a result"
    assert "1,999 random flips" in text
    assert "None" not in text
    assert "{" not in text


def test_what_it_cites_are_the_references_and_no_others():
    found = of(full_study())
    keys = re.findall(r"@\w+\{(\w+),", found.bibtex)
    assert sorted(keys) == sorted(CITED)
    for cited in CITED.values():
        assert cited in found.text
    assert found.bibtex.count("doi = ") == len(keys) - 1, "one is a book without"


def test_what_is_not_known_is_left_out():
    bare = of(full_study(verdict=None, touchdowns=None, sections=None))
    assert "None" not in bare.text
    assert "landings were used" not in bare.text
    assert bare.bibtex == "", "nothing is cited"
    page = build_report(full_study(verdict=None))
    assert "References as BibTeX" not in page
    assert "References as BibTeX" in build_report(full_study())


def test_it_stands_on_the_page_to_be_copied():
    inputs = full_study()
    page = Page(build_report(inputs))
    assert of(inputs).text in page.text.replace("\u00a0", " ")
    assert "doi = {10.1111/rssb.12369}" in page.text


def test_what_limits_a_study_that_cannot_tell_stands_on_the_page():
    cause = {
        "cause": "landings",
        "costs": 0.1,
        "said": "",
        "code": "maps.limit_landings",
        "values": {"landings": 250, "needed": "580", "margin": "20 %"},
    }
    undecided = verdict(conclusion="cannot tell", what_now=[cause])
    page = Page(build_report(full_study(verdict=undecided)))
    assert "Cannot tell: what now?" in page.text
    assert "Landings: 250 are used. About 580 such landings" in page.text
    assert "Cannot tell: what now?" not in Page(build_report(full_study())).text
