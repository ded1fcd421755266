"""Film a typical run to the origin."""

from hopdata.jobs import read_table, reported
from hopdata.steering.experiments.examples import shown_run
from hopdata.steering.figures.runs import save_film

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    film = read_table(snakemake.input.film)
    example = read_table(snakemake.input.example)
    save_film(
        snakemake.output.film,
        film[film["experiment"] == "origin"],
        shown_run(example, "origin"),
    )
