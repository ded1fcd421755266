"""Bootstrap the constraint subspaces of each mode schedule, and measure how far apart they are."""

from hopdata.jobs import reported, write_json, write_table
from hopdata.landings.states.pairs import read_pairs
from hopdata.maps.subspaces import bootstrap_subspaces
from hopdata.maps.subspaces import measure_distances

with reported(snakemake.log[0]):
    pairs, params, output = read_pairs(snakemake.input.pairs), snakemake.params, snakemake.output
    subspaces = bootstrap_subspaces(
        *pairs.normalised(), pairs.schedule, seed=params.seed, **params.subspaces
    )
    study = measure_distances(subspaces.bases, subspaces.shape, seed=params.seed, **params.options)
    write_table(output.distances, study.distances)
    write_table(output.summary, study.summary)
    write_json(output.notes, subspaces.notes + study.notes)
