"""Draw how well kernels of four smoothnesses predict."""

from pathlib import Path

from hopdata.figures.kernel_smoothness import kernel_smoothness_figure
from hopdata.figures.style import save_figure
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    figure = kernel_smoothness_figure(read_table(snakemake.input[0]))
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
