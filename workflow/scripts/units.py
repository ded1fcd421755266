"""Choose the units of a study and write its pairs in them."""

from hopdata.jobs import reported, write_json
from hopdata.landings.pairs import read_pairs, write_pairs
from hopdata.maps.units import choose_units

with reported(snakemake.log[0]):
    pairs = read_pairs(snakemake.input.pairs)
    units = choose_units(pairs, **snakemake.params.options)
    write_pairs(
        snakemake.output.pairs, pairs.in_units(length_m=units.length_m, time_s=units.time_s)
    )
    write_json(snakemake.output.units, units.to_dict())
