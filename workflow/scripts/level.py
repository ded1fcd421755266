"""Fit the floor of one recording and take it off."""

from hopdata.jobs import reported, write_json
from hopdata.landings.floor import fit_floor, level
from hopdata.recordings.readers.hdf5 import read_recording, write_recording

with reported(snakemake.log[0]):
    recording = read_recording(snakemake.input.recording)
    floor = fit_floor(recording, **snakemake.params.options)
    write_recording(snakemake.output.recording, level(recording, floor))
    write_json(snakemake.output.floor, floor.to_dict())
