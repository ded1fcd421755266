"""Draw Fig. 2.5."""

from pathlib import Path

from hopdata.figures.distances import distances_figure
from hopdata.figures.style import save_figure
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    figure = distances_figure(
        read_table(snakemake.input.distances), read_table(snakemake.input.summary)
    )
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
