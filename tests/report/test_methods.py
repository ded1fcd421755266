"""The methods paragraph: a study's own numbers, and references that exist."""

import re
from pathlib import Path

import pandas as pd
import pytest
from fake_study import full_study, no_answer, verdict
from test_page import Page

import hopdata
from hopdata.config.loading import load_config
from hopdata.maps.verdict.model import WINDOW, one_landing, upper_ends
from hopdata.maps.verdict.window import WIDER
from hopdata.messages import Message
from hopdata.report.methods import CITED, methods
from hopdata.report.page import build_report, study_facts
from hopdata.report.tables import NO_FOOT_LANDED
from hopdata.report.verdict import measured

# References of packages, which are cited where their versions are stated.
PACKAGES = {"numpy", "scipy", "numba", "snakemake"}


def of(inputs):
    return methods(inputs, study_facts(inputs))


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


def test_it_says_which_jacobians_are_compared():
    many = verdict(messages={"compared": {"code": "maps.pairs_of_feet", "values": {}}})
    shown = {}
    for name, known in (("few", verdict()), ("many", many)):
        shown[name] = of(full_study(verdict=known)).text
    assert "Jacobians of two orders where all feet touch at once" in shown["few"]
    assert "in which one of two feet is before the other" in shown["many"]


def test_what_it_cites_are_the_references_and_no_others():
    found = of(full_study())
    keys = re.findall(r"@\w+\{(\w+),", found.bibtex)
    stated = {*full_study().provenance["versions"]} & PACKAGES
    assert {*keys} == {*CITED, "hopdata"} - (PACKAGES - stated)
    for key in {*keys} - {"hopdata"}:
        assert CITED[key] in found.text
    assert found.bibtex.count("doi = ") == len(keys) - 2, (
        "a book and software have none"
    )


def test_a_study_without_a_size_claims_no_analysis():
    orders = [{"order": "2 → 3 → 1", "landings": 42}]
    alone = no_answer() | {
        "n_landings": 42,
        "n_window": 0,
        "preliminary": {"orders": orders, "least_landings": 150},
    }
    found = of(full_study(verdict=alone))
    for never_made in ("Bends of this map", "flips", "judged", "intervals"):
        assert never_made not in found.text
    assert "42 landings are fewer than the 150" in found.text
    assert "in one order only" in found.text
    keys = {*re.findall(r"@\w+\{(\w+),", found.bibtex)}
    assert keys <= PACKAGES | {"hopdata"}
    two = alone["preliminary"] | {"orders": [*orders, {"order": "1", "landings": 9}]}
    assert "one order" not in of(full_study(verdict=alone | {"preliminary": two})).text


def test_it_says_how_many_landings_were_fitted():
    text = of(full_study()).text
    assert f"judged from {verdict()['n_window']} landings" in text
    assert f"of {verdict()['n_landings']} whose" in text
    known = verdict()["n_landings"]
    every = of(full_study(verdict=verdict() | {"n_window": known})).text
    assert f"judged from all {known} landings whose" in every


def test_it_says_how_many_landings_are_far_off():
    left_out = {"outcome_far_off": [4, 7], "state_far_off": [9]}
    text = of(full_study(verdict=verdict() | {"gross_errors": left_out})).text
    assert "are known (besides, 3 left out" in text
    none = of(full_study(verdict=verdict() | {"gross_errors": {}})).text
    assert "left out" not in none


def test_it_says_what_an_interval_leaves_open_at_the_contact():
    values = {"twice": "72 %", "spreads": "0.4"}
    parts = {"different": {"code": "maps.different", "values": {}}}
    parts["reservation"] = {"code": "maps.may_be_larger", "values": values}
    said = {"sentence": {"code": "maps.different_reserved", "values": parts}}
    words = "more than 72 % if it fades within 0.4 times the spread of the contacts"
    assert words in of(full_study(verdict=verdict(messages=said))).text
    parts["reservation"] = {"code": "maps.fades", "values": {}}
    without = of(full_study(verdict=verdict(messages=said))).text
    assert "it fades" not in without
    assert "spread of the contacts" not in without


def test_a_simulation_is_called_one():
    simulated = full_study()
    assert simulated.truth
    assert of(simulated).text.startswith("A simulation of")
    assert of(full_study(truth=None, simulated=True)).text.startswith("A simulation")
    recorded = full_study(truth=None)
    assert of(recorded).text.startswith("Motion capture of")


def test_a_walk_knows_a_simulation_by_its_file():
    data = Path(__file__).parents[2] / "data" / "sample"
    assert hopdata.study(data / "hopper.h5")._is_simulated()
    runner = data / "RBDS001runT25markers.tsv"
    feet = ["R_heel", "R_mt1", "R_mt5"]
    measured = hopdata.study(runner, feet=feet, body=["body1", "body2", "body3"])
    assert not measured._is_simulated()
    given = hopdata.study(measured.imported[0])
    assert not given._is_simulated()


def test_one_order_and_no_exclusions_are_good_english():
    inputs = full_study()
    facts = study_facts(inputs) | {"n_schedules": 1, "n_excluded": 0, "n_landings": 42}
    text = methods(inputs, facts).text
    assert "All 42 landings were used." in text
    assert "in one order" in text


def test_what_is_not_known_is_left_out():
    bare = of(full_study(verdict=None, touchdowns=None, sections=None))
    assert "None" not in bare.text
    assert "landings were used" not in bare.text
    keys = {*re.findall(r"@\w+\{(\w+),", bare.bibtex)}
    assert keys <= PACKAGES | {"hopdata"}, "nothing is cited but software"
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


def test_the_head_of_the_page_says_that_there_is_one_order():
    landings = {"code": "maps.not_one", "values": {}, "said": "Landings: too few."}
    values = {"order": "2 → 3 → 1", "landings": 42, "least_of_order": 20}
    only = {"code": "maps.none_for_one_order", "values": values, "said": ""}
    causes = [{"cause": "orders", "costs": None, **only}, landings]
    undecided = no_answer() | {"what_now": causes}
    head = Page(build_report(full_study(verdict=undecided))).text.partition(
        "At a glance"
    )
    assert "Orders: one order occurs, 2 → 3 → 1, in all 42 landings" in head[0]


def test_it_says_why_landings_were_not_used_and_how_sure_the_orders_are():
    table = full_study().touchdowns
    first = table.index[~table["excluded"]][:7]
    table.loc[first, "order_class"] = "ambiguous"
    text = of(full_study(touchdowns=table)).text
    out = table[table["excluded"]]
    assert (out["reason"] != NO_FOOT_LANDED).sum() > 0
    assert "one by one" not in text
    assert f"in 7 of the {(~table['excluded']).sum()} landings" in text
    others = table.assign(
        reason=table["reason"].replace(out["reason"].iloc[0], NO_FOOT_LANDED)
    )
    said = of(full_study(touchdowns=others)).text
    assert f"came down {len(table)} times" in said
    assert NO_FOOT_LANDED not in said, "it is no landing of the study"


def test_the_scene_and_the_noise_of_a_simulation_are_named():
    config = load_config("config/config.yaml")
    config["recordings"] = [{"name": "a", "file": None}]
    made = of(full_study(provenance={"config": config, "versions": {}})).text
    assert made.startswith("A simulation of")
    assert "scene hopper of hopdata" in made
    assert "noise of 0.6 mm" in made


def joined_study():
    """Return a study of two feet of two markers each."""
    feet = {"left": ["L_HEEL", "L_TOE"], "right": ["R_HEEL", "R_TOE"]}
    inputs = full_study()
    table = inputs.touchdowns.assign(contact_left_s=1.0, contact_right_s=1.1)
    record = dict(inputs.provenance)
    joined = [{"name": name, "markers": own} for name, own in feet.items()]
    record["config"] = record["config"] | {"feet": joined}
    recordings = [{**inputs.recordings[0], "n_feet": 4}]
    return full_study(touchdowns=table, provenance=record, recordings=recordings)


def test_markers_of_one_foot_are_one_foot():
    inputs = joined_study()
    text = of(inputs).text
    assert "on 2 feet: left (L_HEEL, L_TOE), right (R_HEEL, R_TOE)" in text
    assert "that of the first of them to land" in text
    page = Page(build_report(inputs)).text.replace("\u00a0", " ")
    assert "of 2 possible, in the touchdowns used" in page
    alone = of(full_study()).text
    assert "on the feet 3" in alone
    assert "first of them to land" not in alone
    assert "of 6 possible" in Page(build_report(full_study())).text


def test_both_paragraphs_say_that_kinks_are_found_by_maximum_likelihood():
    assert "found by maximum likelihood" in of(full_study()).text
    said = str(Message("report.contacts_by_kink"))
    assert "found by maximum likelihood" in said


def test_the_paragraph_tells_of_the_force_plate_where_there_was_one():
    summary = pd.DataFrame(
        {
            "source": ["plates", "events"],
            "column": ["Force plate 1", "pressed"],
            "bias_s": [0.00518, 0.09],
            "bias_low_s": [0.00438, 0.08],
            "bias_high_s": [0.00589, 0.1],
            "robust_sd_s": [0.0024, 0.01],
            "n_matched": [42, 40],
        }
    )
    text = of(full_study(overlay={"contact_overlay_summary": summary})).text
    told = "+5.2 ms (95 % interval +4.4 to +5.9, robust standard deviation 2.4 ms"
    assert f"onsets of force: {told}, 42 contacts; Force plate 1)." in text
    assert "pressed;" not in text
    assert "onsets of force" not in of(full_study()).text


def with_jump():
    """Return a verdict with a jump of three exchanges, and what it allows for."""
    effect = verdict()["effect"] | {"allowed": 0.1015}
    return verdict(
        effect=effect,
        jump=effect | {"allowed": 0.0551, "detectable": 0.09},
        levels={"effect": 0.04075, "jump": 0.0101875},
    )


def test_it_says_what_was_assumed_of_the_errors_of_landings():
    text = of(full_study()).text
    assert "the errors of landings are independent, given the states before" in text
    note = {"code": "maps.err_alike", "values": {"in_a_row": 40}}
    note |= {"what": "landings are not independent", "reason": ""}
    alike = of(full_study(verdict=verdict(notes=[note]))).text
    assert "40 in a row have one sign" in alike
    assert "the errors of landings are independent" not in alike


def test_it_says_the_rule_of_the_answer_and_what_the_margin_decides():
    text = of(full_study()).text
    assert "began above zero, however small the difference" in text
    assert "its one-sided 95 % bound was at most 20 %" in text
    assert "jumps have no such margin" not in text
    assert "jumps have no such margin" in of(full_study(verdict=with_jump())).text
    assert "began above zero" not in of(full_study(verdict=no_answer())).text


def test_it_says_how_what_smooth_maps_leave_enters_the_interval():
    text = of(full_study(verdict=with_jump())).text
    assert "may leave (0.102 for bends and 0.0551 for jumps): with d = 2(a/4)" in text
    alone = of(full_study(verdict=with_jump() | {"jump": None})).text
    assert "may leave (0.102 for bends): with" in alone
    assert "for jumps" not in alone
    assert "e + ((a/2)² + (de)²)^(1/2) above" in alone
    only_jump = with_jump() | {"decided_by": "jump", "effect": None}
    assert (
        "may leave (0.0551 for jumps): with" in of(full_study(verdict=only_jump)).text
    )
    assert "may leave (" not in of(full_study()).text, "it is not known"


def test_the_formula_of_the_paragraph_is_that_of_the_verdict():
    allowed, end = 0.1015, 0.31
    deviation = 2.0 * (allowed / 4.0) ** (2.0 / 3.0)
    assert deviation == pytest.approx(one_landing(allowed), rel=1e-12)
    above = end + ((allowed / 2.0) ** 2 + (deviation * end) ** 2) ** 0.5
    assert upper_ends([end], allowed)[0] == pytest.approx(above, rel=1e-12)


def test_it_says_how_bends_and_jumps_share_the_level():
    text = of(full_study(verdict=with_jump())).text
    assert "at the levels 4.1 % and 1 %; one or both err in 5 % of studies" in text
    assert "at the levels" not in of(full_study()).text
    earlier = with_jump() | {"levels": {}}
    assert "at the levels" not in of(full_study(verdict=earlier)).text


def test_it_says_what_was_chosen_from_the_data_and_taken_off_an_estimate():
    text = of(full_study()).text
    *shares, last = (f"{100 * share:g}" for share in (WINDOW, *WIDER))
    assert f"of {', '.join(shares)} and {last} %, was chosen from the data" in text
    assert "what noise adds on average was subtracted" in (
        of(full_study(verdict=with_jump())).text
    )


def test_it_says_how_often_verdicts_err_as_measured():
    text = of(full_study()).text
    assert str(measured()) in text
    page = Page(build_report(full_study())).text
    assert page.index("How often does it err? On simulated bodies") > 0
    without = Page(build_report(full_study(verdict=no_answer()))).text
    assert "How often does it err" not in without
