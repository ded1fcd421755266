"""The figure of which contact orders differ."""

from itertools import combinations, permutations

import pytest
from overlaps import text_faults

from hopdata.figures.orders import NO_SIZES, NONE_FOUND, orders_figure


def row(first, second, size=0.0, of="map"):
    low = max(0.0, size - 0.1)
    return {
        "of": of,
        "first": first,
        "second": second,
        "estimate": size,
        "low": low,
        "high": size + 0.15,
        "p_value": 0.001 if low else 1.0,
    }


def by_last(size):
    """Return pairs of six orders that differ if they end with different feet."""
    names = [">".join(order) for order in permutations("123")]
    return [row(a, b, size * (a[-1] != b[-1])) for a, b in combinations(names, 2)]


def of_feet(n_feet, size=0.0, of="jump"):
    feet = [str(foot + 1) for foot in range(n_feet)]
    return [row(f"{a}>{b}", f"{b}>{a}", size, of) for a, b in combinations(feet, 2)]


def verdict(orders, mainly="", code=""):
    messages = {"mainly": {"code": code, "values": {}}} if code else {}
    return {
        "confidence": 0.95,
        "orders": orders,
        "mainly": mainly,
        "messages": messages,
    }


def labels(axes):
    return [text.get_text() for text in axes.get_yticklabels()]


def written(axes):
    """Return what is written in the fields, without the letter of the panel."""
    texts = [text.get_text() for text in axes.texts]
    return [text for text in texts if text not in "abc"]


@pytest.mark.parametrize("size", [0.0, 0.42])
@pytest.mark.parametrize(
    "orders",
    [
        [row("1>2", "2>1")],
        of_feet(6, of="map") + of_feet(6),
        of_feet(4, of="map"),
    ],
)
def test_every_number_of_feet_is_drawn_without_overlap(size, orders):
    changed = [one | {"estimate": size, "low": size / 2} for one in orders]
    figure = orders_figure(verdict(changed, "most of all: some" if size else ""))
    assert text_faults(figure) == []
    assert len(figure.axes) == len({one["of"] for one in orders})


def test_what_differs_is_coloured_and_stands_together():
    said = "mainly: orders that end with different feet"
    orders = by_last(0.42) + of_feet(3)
    figure = orders_figure(verdict(orders, said, "maps.end_differently"))
    assert text_faults(figure) == []
    assert figure.get_suptitle() == said.capitalize()
    maps, jumps = figure.axes
    assert written(maps).count("42") == 12
    assert written(maps).count("< 15") == 3
    last = [name[-1] for name in labels(maps)]
    assert last == sorted(last), "orders with the same last foot are neighbours"
    assert written(jumps) == ["< 15"] * 3
    coloured = [field for field in maps.patches if field.get_alpha()]
    assert len(coloured) == 12
    assert not [field for field in jumps.patches if field.get_alpha()]


def test_a_larger_difference_has_a_stronger_colour():
    orders = [row("1>2>3", "1>3>2", 0.2), row("1>2>3", "2>1>3", 0.6)]
    (axes,) = orders_figure(verdict(orders)).axes
    weak, strong = (field.get_alpha() for field in axes.patches)
    assert 0.3 < weak < strong <= 1.0


def test_where_nothing_was_found_the_title_says_so():
    figure = orders_figure(verdict(by_last(0.0)))
    assert figure.get_suptitle() == NONE_FOUND
    assert written(figure.axes[0]) == ["< 15"] * 15


def test_a_study_without_sizes_says_so():
    (text,) = orders_figure(verdict([])).texts
    assert text.get_text().replace("\n", " ") == NO_SIZES
