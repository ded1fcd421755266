"""Draw the verdict's size and power."""

from pathlib import Path

from hopdata.figures.style import save_figure
from hopdata.figures.verdict import verdict_power_figure
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    figure = verdict_power_figure(read_table(snakemake.input[0]))
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
