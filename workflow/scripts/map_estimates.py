"""Estimate the linear map through the landing."""

from hopdata.jobs import read_json, read_table, reported, write_json, write_table
from hopdata.landings.states.pairs import read_pairs
from hopdata.landings.states.pairs import contact_instants
from hopdata.maps.corrected.estimates import estimate_maps

with reported(snakemake.log[0]):
    pairs = read_pairs(snakemake.input.pairs)
    estimates = estimate_maps(
        pairs.x,
        pairs.y,
        contact_instants(pairs, read_table(snakemake.input.touchdowns)),
        time_unit_s=read_json(snakemake.input.units)["time_unit_s"],
    )
    write_table(snakemake.output.table, estimates.table())
    write_json(snakemake.output.maps, estimates.to_dict())
    write_json(snakemake.output.notes, estimates.notes)
