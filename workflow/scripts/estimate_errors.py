"""Compare states, estimates of the landing map and the verdict with the truth."""

import numpy as np

from hopdata.jobs import read_json, read_table, reported, write_table
from hopdata.landings.states.pairs import read_pairs
from hopdata.maps.truth.maps import (
    estimate_errors,
    exact_map,
    exact_table,
    judged,
    true_effect,
    verdict_errors,
)
from hopdata.maps.truth.scoring import state_errors, true_rows
from hopdata.recordings.readers.hdf5 import read_truth
from hopdata.synthesis.scaling import UNKNOWN

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
    # Sizes are shares of what the landings vary that estimate or verdict has used.
    used = true_pairs.x[rows[rows >= 0]]
    exact = None
    if UNKNOWN not in maps:
        exact = exact_map(maps, used, shape=shape, time_unit_s=time_unit_s)
    verdict = read_json(source.verdict)
    effect = None
    if verdict["effect"] and exact is not None:
        weighed = judged(pairs.x, pairs.instants, verdict)
        weighed = weighed[rows[weighed] >= 0]
        effect = true_effect(maps, true_pairs.x[rows[weighed]], pairs.instants[weighed])
    write_table(output.errors, estimate_errors(exact, estimates))
    write_table(output.exact, exact_table(exact))
    write_table(output.verdict, verdict_errors(effect, verdict))
    write_table(output.states, state_errors(pairs, true_pairs, rows))
