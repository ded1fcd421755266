"""States at both sections in the home frame of each touchdown, and the units of the study."""

from hopdata.jobs import read_json, read_tables, reported, write_json, write_table
from hopdata.landings.states.assemble import assemble_pairs, exclude_stateless
from hopdata.landings.states.pairs import write_pairs
from hopdata.landings.contacts.velocity_minimum import example_touchdown
from hopdata.maps.units import choose_units
from hopdata.recordings.readers.hdf5 import read_recording

with reported(snakemake.log[0]):
    recordings = [read_recording(path) for path in snakemake.input.recordings]
    table = read_tables(snakemake.input.touchdowns)
    sections = read_json(snakemake.input.sections)
    pairs = assemble_pairs(
        recordings,
        table,
        pre_height_m=sections["pre_height_m"],
        post_height_m=sections["post_height_m"],
        home_marker=snakemake.params.home["marker"],
        ambiguous=snakemake.params.ambiguous,
        **snakemake.params.states,
    )
    units = choose_units(pairs.x, pairs.y, **snakemake.params.units)
    pairs = pairs.with_units(units.length_unit_m, units.time_unit_s)
    write_pairs(snakemake.output.pairs, pairs)
    write_json(snakemake.output.units, units.to_dict())
    table = exclude_stateless(table, pairs)
    write_table(snakemake.output.touchdowns, table)
    write_table(snakemake.output.example, example_touchdown(recordings, table))
