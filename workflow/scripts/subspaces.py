"""Bootstrap the constraint subspaces of each mode schedule."""

from hopdata.jobs import reported, write_json
from hopdata.landings.pairs import read_pairs
from hopdata.maps.subspaces import bootstrap_subspaces, write_subspaces

with reported(snakemake.log[0]):
    subspaces, notes = bootstrap_subspaces(
        read_pairs(snakemake.input.pairs),
        seed=snakemake.params.seed,
        **snakemake.params.options,
    )
    write_subspaces(snakemake.output.subspaces, subspaces)
    write_json(snakemake.output.notes, notes)
