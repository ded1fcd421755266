"""The methods paragraph of a group: how sizes were averaged, and its references."""

import re

from hopdata.group import put_together
from hopdata.report.group_methods import CITED, group_methods
from hopdata.report.group_page import build_group_page
from test_group import GROUP, made_up


def test_it_says_how_sizes_were_averaged_and_cites_that():
    group = put_together(made_up(12), GROUP)
    found = group_methods(group)
    judged = sum(not row["reason"] for row in group["members"])
    assert "the 12 studies of 12 subjects" in found.text
    assert f"{judged} gave a size" in found.text
    assert "at 95 % confidence" in found.text
    keys = {*re.findall(r"@\w+\{(\w+),", found.bibtex)}
    of_conditions = {"holm1979", "seabold2010"}
    assert keys == {*CITED, "hopdata"} - of_conditions, "no conditions were compared"
    assert "a = 0.100 and b = 0.100" in found.text
    page = build_group_page(group, [])
    assert found.text in page.replace("&#39;", "'")
    assert "says on its own page what limits it" in page.replace("&#39;", "'")


def test_a_group_without_a_size_claims_no_average():
    rows = [{**row, "reason": "no feet"} for row in made_up(3)]
    found = group_methods(put_together(rows, GROUP))
    assert "0 gave a size" in found.text
    assert "not averaged" in found.text
    assert "random-effects" not in found.text
    assert re.findall(r"@\w+\{(\w+),", found.bibtex) == ["hopdata"]
