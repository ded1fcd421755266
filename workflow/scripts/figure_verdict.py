"""Draw the verdict."""

from pathlib import Path

from hopdata.figures.style import save_figure
from hopdata.figures.verdict import verdict_figure
from hopdata.jobs import read_json, read_table, reported

with reported(snakemake.log[0]):
    figure = verdict_figure(read_json(snakemake.input.verdict), read_table(snakemake.input.windows))
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
