"""Draw the distances' sensitivity to noise."""

from pathlib import Path

from hopdata.figures.style import save_figure
from hopdata.figures.distances import sensitivity_figure
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    figure = sensitivity_figure(
        read_table(snakemake.input.sensitivity),
        read_table(snakemake.input.readings),
        read_table(snakemake.input.summary),
    )
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
