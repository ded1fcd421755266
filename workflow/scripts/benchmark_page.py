"""Write the page of the benchmarks: every table, and captioned figures."""

import ast
from datetime import datetime
from pathlib import Path

import pandas as pd

from hopdata.jobs import reported, whole_file
from hopdata.report.inputs import render_caption

# Rows of a table that the page shows, enough to see what it holds.
MOST_ROWS = 13


def line(values):
    """Return a row of a table in Markdown, with empty cells for missing numbers."""
    cells = []
    for value in values:
        if isinstance(value, float):
            cell = f"{value:.4g}"
        else:
            cell = str(value).replace("|", "/")
        cells.append("" if cell == "nan" else cell)
    return f"| {' | '.join(cells)} |"


def described(table):
    """Return a table's beginning in Markdown, below a link to the whole."""
    rows = pd.read_csv(table)
    count = ""
    if len(rows) > MOST_ROWS:
        count = f", {MOST_ROWS} of {len(rows)} rows"
    body = rows.head(MOST_ROWS).itertuples(index=False)
    lines = [line(rows.columns), line(["---"] * len(rows.columns)), *map(line, body)]
    return [f"[{table.name}]({table.name}){count}:", "\n".join(lines)]


def title_of(program):
    """Return the first line of what a program says about itself."""
    tree = ast.parse(Path(program).read_text())
    return ast.get_docstring(tree).splitlines()[0]


def pictures(page, programs):
    """Return the figures with their captions in Markdown, by the making program."""
    drawn = {name: [] for name in programs}
    captions = snakemake.input.captions
    for figure, text in zip(snakemake.input.figures, captions, strict=True):
        name = Path(figure).stem
        table = snakemake.params.drawn_from[name][0]
        program = next(p for p, about in programs.items() if table in about["tables"])
        caption = render_caption(Path(text).read_text(), {}, name=name)
        picture = f"![{caption.alt}]({Path(figure).relative_to(page.parent)})"
        drawn[program] += [f"### {caption.title}", picture, *caption.paragraphs]
    return drawn


with reported(snakemake.log[0], snakemake.input, snakemake.output):
    page = Path(snakemake.output[0])
    programs = snakemake.params.programs
    drawn = pictures(page, programs)
    times = [Path(table).stat().st_mtime for table in snakemake.input.tables]
    first = f"{datetime.fromtimestamp(min(times)):%Y-%m-%d %H:%M}"
    last = f"{datetime.fromtimestamp(max(times)):%Y-%m-%d %H:%M}"
    parts = ["# The benchmarks' last run"]
    parts.append(f"The tables were made from {first} to {last}.")
    for name, about in programs.items():
        parts.append(f"## {title_of(about['file'])}")
        parts.append(f"`{' '.join([name + '.py', *about['arguments']])}`")
        parts += drawn[name]
        for table in about["tables"]:
            parts += described(page.with_name(table))
    with whole_file(page) as file:
        file.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
