"""Arc lengths between constraint subspaces, and their baselines."""

from hopdata.jobs import reported, write_table
from hopdata.maps.distances import sample_distances, summarise_distances
from hopdata.maps.subspaces import read_subspaces

with reported(snakemake.log[0]):
    distances = sample_distances(
        read_subspaces(snakemake.input.subspaces),
        seed=snakemake.params.seed,
        **snakemake.params.options,
    )
    write_table(snakemake.output.distances, distances)
    write_table(snakemake.output.summary, summarise_distances(distances))
