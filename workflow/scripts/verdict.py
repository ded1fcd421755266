"""Judge whether the map through the landing is C1."""

from hopdata.jobs import reported, write_json, write_table
from hopdata.landings.states.pairs import read_pairs
from hopdata.maps.verdict import judge

with reported(snakemake.log[0]):
    pairs = read_pairs(snakemake.input.pairs)
    verdict = judge(
        pairs.x,
        pairs.y,
        pairs.instants,
        seed=snakemake.params.seed,
        time_unit_s=pairs.time_unit_s,
        **snakemake.params.options,
    )
    write_json(snakemake.output.verdict, verdict.to_dict())
    write_table(snakemake.output.windows, verdict.windows_table())
