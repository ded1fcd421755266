"""Fill short gaps of the body markers of one recording."""

from hopdata.jobs import reported
from hopdata.landings.filling import fill_gaps
from hopdata.recordings.readers.hdf5 import read_recording, write_recording

with reported(snakemake.log[0]):
    recording = fill_gaps(
        read_recording(snakemake.input.recording),
        longest_s=snakemake.params.longest_s,
        method=snakemake.params.method,
    )
    write_recording(snakemake.output.recording, recording)
