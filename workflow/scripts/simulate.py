"""Simulate one recording."""

from hopdata.jobs import reported
from hopdata.recordings.readers.hdf5 import write_recording
from hopdata.synthesis import simulate_recording

with reported(snakemake.log[0]):
    recording, truth = simulate_recording(
        snakemake.params.simulation,
        snakemake.params.motion_capture,
        seed=(snakemake.params.seed, snakemake.params.number),
        name=snakemake.wildcards.recording,
    )
    write_recording(snakemake.output.recording, recording, truth=truth)
