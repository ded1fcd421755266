"""Choose the units of a study and write its pairs in them."""

from hopdata.jobs import reported, write_json
from hopdata.landings.states.pairs import read_pairs, write_pairs
from hopdata.maps.units import choose_units

with reported(snakemake.log[0]):
    pairs = read_pairs(snakemake.input.pairs)
    units = choose_units(pairs.x, pairs.y, **snakemake.params.options)
    scaled = pairs.in_units(length_m=units.length_unit_m, time_s=units.time_unit_s)
    write_pairs(snakemake.output.pairs, scaled)
    write_json(snakemake.output.units, units.to_dict())
