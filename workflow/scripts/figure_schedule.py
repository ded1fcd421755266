"""Draw Fig. 2.3."""

from pathlib import Path

from hopdata.figures.style import save_figure
from hopdata.figures.schedule import schedule_figure, touchdown_of
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    example = read_table(snakemake.input.example)
    figure = schedule_figure(example, touchdown_of(example, read_table(snakemake.input.touchdowns)))
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
