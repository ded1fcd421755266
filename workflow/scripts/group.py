"""Put the members of a group on one page."""

from pathlib import Path

from hopdata.arrays import pd
from hopdata.figures.sizes import sizes_figure
from hopdata.figures.style import save_figure
from hopdata.figures.verdict import group_figure
from hopdata.group import one_by_one, put_together
from hopdata.jobs import read_json, reported, whole_file, write_json, write_table
from hopdata.report.group_page import build_group_page
from hopdata.report.inputs import read_figures

# Parts of a row that are no cells of a table.
NO_CELLS = ["further", "quality", "what_now", "contacts", "lags"]

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    output = snakemake.output
    rows = [read_json(path) for path in snakemake.input.members]
    group = put_together(rows, snakemake.params.group)
    flat = [{**row, **row["further"]} for row in rows]
    table = pd.DataFrame(flat).drop(columns=NO_CELLS, errors="ignore")
    write_table(output.table, table)
    write_json(output.answer, group)
    picture = Path(output.figure).with_suffix("")
    few = one_by_one(rows)
    drawing = group_figure if few else sizes_figure
    save_figure(drawing(group), picture, formats=["svg"])
    # Without an answer there is nothing to see in the figure.
    has_answer = any(not row["reason"] for row in rows)
    drawn = [output.figure] if has_answer else []
    figures = read_figures(drawn, [snakemake.input.captions])
    with whole_file(output.page) as draft:
        page = build_group_page(group, figures, one_by_one=few)
        draft.write_text(page, encoding="utf-8")
