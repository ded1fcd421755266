"""Draw Fig. 2.4."""

from pathlib import Path

from hopdata.figures.prediction import prediction_figure
from hopdata.figures.style import save_figure
from hopdata.jobs import read_json, read_table, reported

with reported(snakemake.log[0]):
    figure = prediction_figure(
        read_table(snakemake.input.summary), read_json(snakemake.input.units)
    )
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
