"""Draw the error of the estimated map by number of landings and noise."""

from pathlib import Path

from hopdata.figures.maps import map_error_figure
from hopdata.figures.style import save_figure
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    figure = map_error_figure(read_table(snakemake.input[0]))
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
