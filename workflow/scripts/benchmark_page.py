"""Write the page of the benchmarks: every table, and the figures above their captions."""

import ast
from datetime import datetime
from pathlib import Path

import pandas as pd

from hopdata.jobs import reported, whole_file
from hopdata.report.inputs import render_caption

MOST_ROWS = 13  # rows of a table shown on the page, enough to see what it holds


def line(values):
    """Return a row of a table in Markdown, with empty cells for missing numbers."""
    cells = (
        f"{x:.4g}" if isinstance(x, float) else str(x).replace("|", "/") for x in values
    )
    return f"| {' | '.join('' if cell == 'nan' else cell for cell in cells)} |"


with reported(snakemake.log[0]):
    page, programs = Path(snakemake.output[0]), snakemake.params.programs
    drawn = {name: [] for name in programs}
    for figure, text in zip(
        snakemake.input.figures, snakemake.input.captions, strict=True
    ):
        name = Path(figure).stem
        table = snakemake.params.drawn_from[name][0]
        program = next(p for p, about in programs.items() if table in about["tables"])
        caption = render_caption(Path(text).read_text(), {}, name=name)
        picture = f"![{caption.alt}]({Path(figure).relative_to(page.parent)})"
        drawn[program] += [f"### {caption.title}", picture, *caption.paragraphs]
    made = [
        datetime.fromtimestamp(Path(table).stat().st_mtime)
        for table in snakemake.input.tables
    ]
    when = f"The tables were made from {min(made):%Y-%m-%d %H:%M} to {max(made):%Y-%m-%d %H:%M}."
    parts = ["# The benchmarks' last run", when]
    for name, about in programs.items():
        title = ast.get_docstring(
            ast.parse(Path(about["file"]).read_text())
        ).splitlines()[0]
        parts += [
            f"## {title}",
            f"`{' '.join([name + '.py', *about['arguments']])}`",
            *drawn[name],
        ]
        for table in about["tables"]:
            rows = pd.read_csv(page.with_name(table))
            count = (
                f", {MOST_ROWS} of {len(rows)} rows" if len(rows) > MOST_ROWS else ""
            )
            body = rows.head(MOST_ROWS).itertuples(index=False)
            lines = [
                line(rows.columns),
                line(["---"] * len(rows.columns)),
                *map(line, body),
            ]
            parts += [f"[{table}]({table}){count}:", "\n".join(lines)]
    with whole_file(page) as file:
        file.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
