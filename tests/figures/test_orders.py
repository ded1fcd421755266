"""The figure of which contact orders differ."""

from itertools import combinations, permutations

import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.figures.orders import NO_SIZES, label_of, orders_figure


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


def own(size=0.0):
    names = [">".join(order) for order in permutations("123")]
    return [row(name, "others", size * (name == "2>1>3"), "order") for name in names]


def verdict(orders):
    return {"confidence": 0.95, "orders": orders}


def table_of(*feet):
    columns = ["schedule", *(f"contact_{foot}_s" for foot in feet), "spread_s"]
    return pd.DataFrame(columns=columns)


def labels(axes):
    return [text.get_text() for text in axes.get_yticklabels()]


def filled(axes):
    """Return the labels of the rows whose mark is filled."""
    found = []
    for line in axes.lines:
        if line.get_marker() == "o" and line.get_markerfacecolor() != "white":
            found.append(labels(axes)[round(line.get_ydata()[0])])
    return found


@pytest.mark.parametrize("size", [0.0, 0.42])
@pytest.mark.parametrize(
    "orders",
    [
        [row("1>2", "2>1")],
        of_feet(6, of="map") + of_feet(6),
        of_feet(4, of="map"),
        by_last(0.42) + own(0.3) + of_feet(3),
    ],
)
def test_every_number_of_feet_is_drawn_without_overlap(size, orders):
    ends = {"estimate": size, "low": size / 2, "high": size + 0.2}
    changed = [one | ends for one in orders]
    long_names = [f"left hind metatarsal number {foot}" for foot in range(6)]
    for feet in (("toe", "heel", "hallux", "d", "e", "f"), long_names):
        figure = orders_figure(verdict(changed), table_of(*feet))
        assert len(figure.axes) == len({one["of"] for one in orders})
        assert text_faults(figure) == []


def test_what_differs_is_filled_and_named_by_its_feet():
    orders = by_last(0.42) + own(0.3) + of_feet(3)
    figure = orders_figure(verdict(orders), table_of("toe", "heel", "hallux"))
    maps, alone, jumps = figure.axes
    assert len(filled(maps)) == 12
    assert filled(alone) == ["heel → toe → hallux"]
    assert filled(jumps) == []
    assert labels(maps)[:12] == filled(maps), "the clearest stand first"
    assert set(labels(jumps)) == {
        "toe and heel",
        "toe and hallux",
        "heel and hallux",
    }


def test_intervals_are_those_given():
    (axes,) = orders_figure(verdict([row("1>2", "2>1", 0.4)])).axes
    interval, estimate = axes.lines
    assert list(interval.get_xdata()) == pytest.approx([30.0, 55.0])
    assert estimate.get_xdata()[0] == pytest.approx(40.0)


def test_one_endless_interval_does_not_squeeze_the_others():
    endless = row("1>2>3", "3>2>1") | {"high": 1e3}
    (axes,) = orders_figure(verdict([endless, *by_last(0.42)])).axes
    assert axes.get_xlim()[1] < 300
    assert [line for line in axes.lines if line.get_marker() == ">"]


def test_without_names_feet_are_numbered():
    assert label_of(row("1>2>3", "3>2>1"), ()) == "1 → 2 → 3  |  3 → 2 → 1"
    assert label_of(row("1>2>3", "others", of="order"), ("a",)) == "1 → 2 → 3"


def test_a_study_without_sizes_says_so():
    (text,) = orders_figure(verdict([])).texts
    assert text.get_text().replace("\n", " ") == NO_SIZES
