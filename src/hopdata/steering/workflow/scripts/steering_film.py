"""Film a typical run to the origin."""

from hopdata.jobs import read_table, reported
from hopdata.steering.figures.runs import save_film

with reported(snakemake.log[0]):
    film, example = (
        read_table(path) for path in (snakemake.input.film, snakemake.input.example)
    )
    chosen = [table[table["experiment"] == "origin"] for table in (film, example)]
    save_film(snakemake.output.film, *chosen)
