"""Find the touchdowns of one recording, their contact instants and mode schedules."""

from hopdata.jobs import read_json, reported, write_table
from hopdata.landings.filling import mark_filled
from hopdata.landings.touchdowns import left_out, touchdown_table
from hopdata.recordings.readers.hdf5 import read_recording

with reported(snakemake.log[0]):
    sections = read_json(snakemake.input.sections)
    recording = read_recording(snakemake.input.recording)
    for method, path in zip(snakemake.params.methods, snakemake.output.touchdowns, strict=True):
        table = touchdown_table(
            recording,
            pre_height_m=sections["pre_height_m"],
            post_height_m=sections["post_height_m"],
            **{**snakemake.params.options, "method": method},
        )
        table = mark_filled(recording, table, largest_share=snakemake.params.largest_share)
        write_table(path, left_out(table, snakemake.params.exclude))
