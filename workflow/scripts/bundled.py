"""Add the difference of the exact maps to a simulated recording's truth."""

from dataclasses import replace

from hopdata.jobs import read_json, reported
from hopdata.landings.states.pairs import read_pairs
from hopdata.maps.truth.maps import true_effect
from hopdata.recordings.readers.hdf5 import read_recording, read_truth, write_recording

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    source = snakemake.input
    recording = read_recording(source.recording)
    truth = read_truth(source.recording)
    states = read_pairs(source.pairs).x
    effect = true_effect(read_json(source.maps), states, truth.contact_times)
    known = replace(truth, true_effect=effect)
    write_recording(snakemake.output[0], recording, truth=known)
