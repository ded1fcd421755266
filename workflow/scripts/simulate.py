"""Simulate one recording of the three-legged hopper."""

from hopdata.jobs import reported
from hopdata.recordings.hdf5 import write_recording
from hopdata.synthesis import simulate_recording

with reported(snakemake.log[0]):
    recording, truth = simulate_recording(
        snakemake.wildcards.recording,
        simulation=snakemake.params.simulation,
        motion_capture=snakemake.params.motion_capture,
        seed=(snakemake.params.seed, snakemake.params.number),
    )
    write_recording(snakemake.output.recording, recording, truth=truth)
