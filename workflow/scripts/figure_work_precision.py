"""Draw work and precision of the integrator and its peers."""

from pathlib import Path

from hopdata.figures.style import save_figure
from hopdata.figures.integrator import work_precision_figure
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    figure = work_precision_figure(*map(read_table, snakemake.input))
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
