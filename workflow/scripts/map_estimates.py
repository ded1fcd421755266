"""Estimate the linear map through the landing."""

from hopdata.jobs import reported, write_json, write_table
from hopdata.landings.states.pairs import read_pairs
from hopdata.maps.corrected.estimates import estimate_maps

with reported(snakemake.log[0]):
    pairs = read_pairs(snakemake.input.pairs)
    estimates = estimate_maps(
        pairs.x,
        pairs.y,
        pairs.instants,
        time_unit_s=pairs.time_unit_s,
    )
    write_table(snakemake.output.table, estimates.table())
    write_json(snakemake.output.maps, estimates.to_dict())
    write_json(snakemake.output.notes, estimates.notes)
