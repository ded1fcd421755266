"""States at both sections in the home frame of each touchdown."""

from hopdata.jobs import read_json, read_tables, reported, write_table
from hopdata.landings.states.assemble import assemble_pairs, exclude_stateless
from hopdata.landings.states.pairs import write_pairs
from hopdata.landings.contacts.velocity_minimum import example_touchdown
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
    write_pairs(snakemake.output.pairs, pairs)
    table = exclude_stateless(table, pairs)
    write_table(snakemake.output.touchdowns, table)
    write_table(snakemake.output.example, example_touchdown(recordings, table))
