"""Add the difference of the exact maps to a simulated recording's truth."""

from dataclasses import replace

from hopdata.errors import AnalysisError
from hopdata.jobs import read_json, reported
from hopdata.landings.states.pairs import read_pairs
from hopdata.maps.truth.maps import true_effect
from hopdata.recordings.readers.hdf5 import read_recording, read_truth, write_recording
from hopdata.synthesis.scaling import UNKNOWN

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    source = snakemake.input
    recording = read_recording(source.recording)
    truth = read_truth(source.recording)
    states = read_pairs(source.pairs).x
    maps = read_json(source.maps)
    if UNKNOWN in maps:
        raise AnalysisError.at("exact maps", "those of each order", maps[UNKNOWN])
    effect = true_effect(maps, states, truth.contact_times)
    known = replace(truth, true_effect=effect)
    write_recording(snakemake.output[0], recording, truth=known)
