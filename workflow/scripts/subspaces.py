"""Bootstrap the constraint subspaces of each mode schedule."""

from hopdata.jobs import reported, write_json
from hopdata.landings.states.pairs import read_pairs
from hopdata.maps.subspaces.constraint import bootstrap_subspaces, write_subspaces

with reported(snakemake.log[0]):
    pairs = read_pairs(snakemake.input.pairs)
    study = bootstrap_subspaces(
        pairs.x,
        pairs.y,
        pairs.schedule,
        seed=snakemake.params.seed,
        **snakemake.params.options,
    )
    write_subspaces(snakemake.output.subspaces, study)
    write_json(snakemake.output.notes, study.notes)
