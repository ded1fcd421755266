"""Inspect the recordings of a study."""

from hopdata.jobs import reported, write_table
from hopdata.recordings.quality.inspection import recording_tables
from hopdata.recordings.readers.hdf5 import read_recording

with reported(snakemake.log[0]):
    recordings = (read_recording(path) for path in snakemake.input.recordings)
    for name, table in recording_tables(recordings).items():
        write_table(snakemake.output[name], table)
