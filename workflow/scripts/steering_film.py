"""Film a typical run to the origin."""

from hopdata.figures.steering import save_film
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    save_film(
        snakemake.output.film,
        read_table(snakemake.input.film),
        read_table(snakemake.input.example),
    )
