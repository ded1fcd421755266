"""Draw the contacts found beside those that are known from elsewhere."""

from pathlib import Path

from hopdata.figures.overlay import contact_overlay_figure
from hopdata.figures.style import save_figure
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    figure = contact_overlay_figure(
        read_table(snakemake.input.contacts),
        read_table(snakemake.input.summary),
        read_table(snakemake.input.example),
    )
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
