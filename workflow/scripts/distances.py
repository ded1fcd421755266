"""Arc lengths between constraint subspaces, and their baselines."""

from hopdata.jobs import reported, write_json, write_table
from hopdata.maps.subspaces.distances import measure_distances
from hopdata.maps.subspaces.constraint import read_bases

with reported(snakemake.log[0]):
    bases, shape = read_bases(snakemake.input.subspaces)
    study = measure_distances(
        bases,
        shape,
        seed=snakemake.params.seed,
        workers=snakemake.threads,
        progress=True,
        **snakemake.params.options,
    )
    write_table(snakemake.output.distances, study.distances)
    write_table(snakemake.output.summary, study.summary)
    write_json(snakemake.output.notes, study.notes)
