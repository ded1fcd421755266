"""Draw the errors of fitted maps by the number of landings."""

from pathlib import Path

from hopdata.figures.maps import map_errors_figure
from hopdata.figures.style import save_figure
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    figure = map_errors_figure(read_table(snakemake.input.errors))
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
