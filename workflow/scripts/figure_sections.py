"""Draw Fig. 2.2."""

from pathlib import Path

from hopdata.figures.style import save_figure
from hopdata.figures.sections import sections_figure
from hopdata.jobs import read_json, read_table, reported

with reported(snakemake.log[0]):
    figure = sections_figure(
        read_table(snakemake.input.frames),
        read_table(snakemake.input.densities),
        read_json(snakemake.input.sections),
    )
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
