"""Simulate the trial that the model of steering is learned from."""

from hopdata.jobs import reported, write_table
from hopdata.recordings.readers.hdf5 import write_recording
from hopdata.steering.trial import simulate_excitation

with reported(snakemake.log[0]):
    trial = simulate_excitation(
        snakemake.params.steering, snakemake.params.motion_capture, seed=snakemake.params.seed
    )
    write_recording(snakemake.output.recording, trial.recording)
    write_table(snakemake.output.stances, trial.stances)
    write_table(snakemake.output.motion, trial.motion)
