"""Draw the estimated landing maps, beside the exact one where it is known."""

from pathlib import Path

from hopdata.figures.maps import matrices_figure
from hopdata.figures.style import save_figure
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    source = snakemake.input
    exact = read_table(source.exact[0]) if source.exact else None
    figure = matrices_figure(read_table(source.estimates), exact)
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
