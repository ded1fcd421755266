"""Judge whether the map through the landing is C1."""

from hopdata.jobs import read_table, reported, write_json
from hopdata.landings.checks import blurred
from hopdata.landings.states.pairs import read_pairs
from hopdata.maps.verdict import judge

with reported(snakemake.log[0]):
    pairs = read_pairs(snakemake.input.pairs)
    verdict = judge(
        pairs.x,
        pairs.y,
        pairs.instants,
        instants_se=pairs.instants_se,
        seed=snakemake.params.seed,
        blurred=blurred(read_table(snakemake.input.touchdowns)),
        **snakemake.params.options,
    )
    write_json(snakemake.output.verdict, verdict.to_dict())
