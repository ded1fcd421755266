"""Draw Fig. 2.5 of two studies side by side."""

from pathlib import Path

from hopdata.figures.distances import both_sides_figure
from hopdata.figures.style import save_figure
from hopdata.jobs import read_json, read_table, reported

with reported(snakemake.log[0]):
    files = zip(
        snakemake.input.distances, snakemake.input.summaries, snakemake.input.verdicts, strict=True
    )
    studies = {
        name: (read_table(distances), read_table(summary), read_json(verdict))
        for name, (distances, summary, verdict) in zip(snakemake.params.names, files, strict=True)
    }
    figure = both_sides_figure(studies)
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
