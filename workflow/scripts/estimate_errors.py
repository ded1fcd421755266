"""Compare states, estimates of the landing map and the verdict with the truth."""

import numpy as np

from hopdata.jobs import read_json, read_table, reported, write_table
from hopdata.landings.states.pairs import read_pairs
from hopdata.maps.truth.maps import (
    estimate_errors,
    exact_map,
    true_effect,
    verdict_errors,
)
from hopdata.maps.truth.scoring import state_errors, true_rows
from hopdata.recordings.readers.hdf5 import read_truth

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    source = snakemake.input
    output = snakemake.output
    pairs = read_pairs(source.pairs)
    true_pairs = read_pairs(source.true_pairs)
    names = snakemake.params.recordings
    contacts = {
        name: read_truth(path).contact_times
        for name, path in zip(names, source.recordings, strict=True)
    }
    feet = snakemake.params.markers["feet"]
    touchdowns = read_table(source.touchdowns)
    rows = true_rows(pairs, touchdowns, true_pairs, contacts, feet)
    estimates = read_json(source.estimates)
    maps = read_json(source.maps)
    shape = np.array(estimates["shape_m"]).reshape(-1, 3)
    time_unit_s = read_json(source.units)["time_unit_s"]
    exact = exact_map(maps, true_pairs.x, shape=shape, time_unit_s=time_unit_s)
    effect = true_effect(maps, true_pairs.x, pairs.instants)
    write_table(output.errors, estimate_errors(exact, estimates))
    write_table(output.exact, exact.table())
    write_table(output.verdict, verdict_errors(effect, read_json(source.verdict)))
    write_table(output.states, state_errors(pairs, true_pairs, rows))
