"""Draw the scaling study."""

from pathlib import Path

from hopdata.figures.style import save_figure
from hopdata.figures.maps import scaling_study_figure
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    figure = scaling_study_figure(read_table(snakemake.input.scaling))
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
