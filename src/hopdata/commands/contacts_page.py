"""The page of ``hopdata contacts``: each landing's curves, and the tables."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.errors import counted
from hopdata.messages import Message, in_shell, without_exponent
from hopdata.report import formatting as show
from hopdata.report.formatting import MISSING, Table
from hopdata.report.inputs import ReportFigure, picture_of, rendered
from hopdata.report.tables import lags_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hopdata.arrays import pd
    from hopdata.contact_times import ContactTimes

# Landings whose curves are shown, and how many of them a picture holds. Of more
# landings, half of those shown are the ones whose order is least sure.
MOST_SHOWN = 96
IN_A_PICTURE = 24

# Contacts in the table of the page.
MOST_ROWS = 400


def contacts_html(
    found: ContactTimes,
    *,
    title: str,
    notes: Sequence[str],
    places: Sequence[str] = (),
) -> str:
    """Write the page, for one landing as for a thousand.

    Parameters
    ----------
    found : ContactTimes
        The contacts.
    title : str
        Names of the recordings.
    notes : sequence of str
        What to know about the recordings.
    places : sequence of str
        Names of the only recording, with which no note begins.
    """
    shown = _shown(found.orders)
    # What concerns the contacts comes before what concerns the recordings.
    of_contacts = [str(in_shell(one)) for one in found.messages]
    told = without_places([*of_contacts, *notes], places)
    n_left_out = len(found.orders) - len(shown)
    if n_left_out:
        values = {"shown": len(shown), "landings": len(found.orders)}
        told.append(str(Message("commands.curves_limited", values)))
    n_rows_left = len(found.table) - MOST_ROWS
    if n_rows_left > 0:
        values = {"shown": MOST_ROWS, "contacts": len(found.table)}
        told.append(str(Message("commands.rows_limited", values)))
    return rendered(
        "contacts.html.j2",
        title=title,
        answer=f"{found}.",
        highlights=_highlights(found),
        notes=told,
        methods=found.methods(),
        pictures=_pictures(found, shown),
        tables=[
            table
            for table in (
                lags_of(found),
                _order_table(found),
                _contact_table(found),
            )
            if table and table.rows
        ],
    )


def without_places(notes: Sequence[str], places: Sequence[str]) -> list[str]:
    """Return notes without the names of the only recording before them."""
    told = []
    for note in notes:
        for place in places:
            note = note.removeprefix(f"{place}: ")
        told.append(note)
    return told


def _shown(orders: pd.DataFrame) -> pd.DataFrame:
    """Return the landings whose curves are shown, in order of time."""
    if len(orders) <= MOST_SHOWN:
        return orders
    doubt = orders["probability"].fillna(1.0)
    least_sure = doubt.sort_values(kind="stable").index[: MOST_SHOWN // 2]
    others = orders.index.difference(least_sure)
    every = np.linspace(0, len(others) - 1, MOST_SHOWN - len(least_sure)).round()
    chosen = least_sure.union(others[every.astype(int)])
    return orders.loc[sorted(chosen)]


def _highlights(found: ContactTimes) -> list[tuple[str, str, str]]:
    """Return title, value and remark of each fact at the top of the page."""
    orders = found.orders
    ordered = orders[orders["probability"].notna()]
    untrusted = len(found.table) - len(found.found)
    doubt = "each with an instant to be trusted"
    if untrusted:
        doubt = f"{untrusted} more are not to be trusted"
    feet = ", ".join(dict.fromkeys(found.table["foot"]))
    facts = [
        ("Landings", f"{len(orders)}", f"of {feet}"),
        ("Contacts", f"{len(found.found)}", doubt),
    ]
    if len(found.found):
        error = f"{without_exponent(1e3 * found.median_se_s)} ms"
        facts.append(("Standard error", error, "of a contact, median"))
        # It belongs to a foot, so that a median over feet would be that of one of them.
        common_s = found.found["common_s"].max()
        if np.isfinite(common_s):
            common = f"{without_exponent(1e3 * common_s)} ms"
            remark = "the largest of a foot in a recording, whose contacts share it"
            facts.append(("Common error", common, remark))
    beside = [
        one for one in found.messages if one.code == "landings.contacts_beside_plates"
    ]
    facts += [_beside_plates(one.values) for one in beside]
    if len(ordered):
        n_sure = int(ordered["sure"].sum())
        facts.append(
            ("Sure orders", f"{n_sure} of {len(ordered)}", _most_often(ordered))
        )
    return facts


def _beside_plates(values: Mapping[str, Any]) -> tuple[str, str, str]:
    """Return title, value and remark of contacts beside force plates."""
    remark = f"median of {counted(values['number'], 'contact')}; "
    scatter = values["scatter"].values
    if scatter:
        remark += f"scatter {scatter['scatter_ms']:.1f} ms; "
    remark += f"{values['most_ms']:.1f} ms at most"
    return "After the force plate", f"{values['middle_ms']:+.1f} ms", remark


def _most_often(ordered: pd.DataFrame) -> str:
    """Return the commonest sure order and how often it occurs."""
    sure = ordered.loc[ordered["sure"], "order"]
    if not len(sure):
        return "none is sure"
    counts = sure.value_counts()
    return f"most often {counts.index[0]} ({counts.iloc[0]})"


def _pictures(found: ContactTimes, shown: pd.DataFrame) -> list[Any]:
    """Return all pictures with their captions."""
    from hopdata.figures.contacts import landings_figure, spread_figure

    feet = found.feet
    pictures = []
    n_pages = -(-len(shown) // IN_A_PICTURE)
    for page in range(n_pages):
        part = shown.iloc[page * IN_A_PICTURE : (page + 1) * IN_A_PICTURE]
        own = found.table.merge(
            part[["recording", "landing"]], on=["recording", "landing"]
        )
        figure = landings_figure(found.curves(part), own, part, feet)
        number = f" ({page + 1} of {n_pages})" if n_pages > 1 else ""
        caption = Message("commands.landings_caption", {"number": number})
        pictures.append(_picture(f"landings{page + 1}", figure, str(caption)))
    if found.orders["probability"].notna().sum() > 1:
        caption = Message("commands.spread_caption")
        figure = spread_figure(found.table, found.orders, feet)
        pictures.append(_picture("spread", figure, str(caption)))
    return pictures


def _picture(name: str, figure: Figure, caption: str) -> Any:
    from hopdata.figures.catalogue import FORMATS
    from hopdata.figures.style import style_context

    buffer = io.BytesIO()
    with style_context():
        figure.savefig(buffer, format="svg", metadata=dict(FORMATS["svg"]))
    drawn = ReportFigure(name, buffer.getvalue(), "image/svg+xml", caption)
    return picture_of(drawn, {})


def lags_of(found: ContactTimes) -> Table | None:
    """Return how long each foot touches before each other; None without two feet."""
    rows = show.records(found.lags())
    return lags_table(rows, str(Message("commands.lags_note")))


def _order_table(found: ContactTimes) -> Table:
    """Return how often each order occurs, and how many of these are sure."""
    ordered = found.orders[found.orders["probability"].notna()]
    rows = []
    for order, own in ordered.groupby("order", sort=True):
        n_sure = int(own["sure"].sum())
        rows.append((str(order), f"{len(own)}", f"{n_sure}"))
    rows.sort(key=lambda row: -int(row[1]))
    head = ("order", "landings", "sure")
    return Table("Orders of contacts", head, tuple(rows))


def _contact_table(found: ContactTimes) -> Table:
    """Return a row for each contact."""
    several = found.table["recording"].nunique() > 1
    table = found.table.assign(late_ms=_after_plate_ms(found.table))
    has_plates = bool(table["late_ms"].notna().any())
    has_markers = bool(table["marker_probability"].notna().any())
    rows = []
    for contact in table.head(MOST_ROWS).to_dict("records"):
        name = f"{contact['landing']}"
        if several:
            name = f"{contact['recording']} {name}"
        numbers = [
            _number(contact["contact_s"], 4),
            _number(1e3 * contact["se_s"], 2),
            _number(1e3 * contact["common_s"], 2),
        ]
        if has_plates:
            numbers.append(_number(float(contact["plate_s"]), 4))
            numbers.append(_number(contact["late_ms"], 1))
        texts = [name, contact["foot"], contact["remark"]]
        if has_markers:
            texts.insert(2, contact["marker"])
            numbers.insert(0, _number(contact["marker_probability"], 3))
        rows.append((*texts, *numbers))
    texts_head = ["landing", "foot", "remark"]
    head = ["contact (s)", "standard error (ms)", "common error (ms)"]
    if has_markers:
        texts_head.insert(2, "first marker")
        head.insert(0, "probability that it is first")
    if has_plates:
        head += ["plate (s)", "contact after plate (ms)"]
    note = str(Message("commands.contacts_note"))
    return Table(
        "Contacts",
        (*texts_head, *head),
        tuple(rows),
        text_columns=len(texts_head),
        note=note,
    )


def _after_plate_ms(table: pd.DataFrame) -> pd.Series:
    """Return how long after the onset of a force plate each contact is, ms, or NaN."""
    return 1e3 * (table["contact_s"] - table["plate_s"].astype(float))


def _number(value: float, decimals: int) -> str:
    if not np.isfinite(value):
        return MISSING
    return f"{value:.{decimals}f}"
