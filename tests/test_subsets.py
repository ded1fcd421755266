"""Every subset of each list of choices in the schema runs, down to the figures and the page."""

import pytest
from test_page import Page

from choices import lists_of_choices, subsets, without_products
from hopdata.config.schema import load_schema
from hopdata.figures.style import message_figure, save_figure
from hopdata.report.inputs import ReportInputs, read_figures
from hopdata.report.page import build_report

LISTS = dict(lists_of_choices(without_products(load_schema())))


def run_formats(formats, folder):
    save_figure(message_figure("A figure."), folder / "map_matrices", formats=formats)
    files = sorted(folder.iterdir())
    assert [file.suffix[1:] for file in files] == sorted(formats)
    page = Page(build_report(ReportInputs("a", figures=read_figures(files, []))))
    shown = any(kind in formats for kind in ("svg", "png"))
    assert ("not made in a format that a page can show" in page.text) == (not shown)
    assert len(page.images) == int(shown)


# What runs each list; a list of the schema that is missing here fails the test below.
EACH = {
    "figures.formats": run_formats,
}


def test_every_list_of_choices_is_covered():
    assert set(LISTS) == set(EACH)


@pytest.mark.parametrize(
    ("path", "some"),
    [(path, some) for path, choices in LISTS.items() for some in subsets(choices)],
    ids=lambda value: "+".join(value) if isinstance(value, tuple) else value,
)
def test_every_subset_runs(path, some, tmp_path):
    EACH[path](some, tmp_path)
