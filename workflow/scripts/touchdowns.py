"""Find the touchdowns of one recording, their contact instants and mode schedules."""

from hopdata.jobs import read_json, reported, write_table
from hopdata.landings.filling import mark_filled
from hopdata.landings.touchdowns import touchdown_table
from hopdata.recordings.hdf5 import read_recording

with reported(snakemake.log[0]):
    sections = read_json(snakemake.input.sections)
    options = {**snakemake.params.options, "method": snakemake.wildcards.method}
    recording = read_recording(snakemake.input.recording)
    table = touchdown_table(
        recording,
        pre_height_m=sections["pre_height_m"],
        post_height_m=sections["post_height_m"],
        **options,
    )
    table = mark_filled(recording, table, largest_share=snakemake.params.largest_share)
    write_table(snakemake.output.touchdowns, table)
