"""Compare the estimates of the landing map, and the verdict, with the exact maps."""

import numpy as np

from hopdata.jobs import read_json, reported, write_table
from hopdata.landings.states.pairs import read_pairs
from hopdata.maps.truth.maps import estimate_errors, exact_map
from hopdata.maps.truth.maps import true_effect, verdict_errors

with reported(snakemake.log[0]):
    estimates = read_json(snakemake.input.estimates)
    maps, states = read_json(snakemake.input.maps), read_pairs(snakemake.input.true_pairs).x
    instants = read_pairs(snakemake.input.pairs).instants
    time_unit_s = read_json(snakemake.input.units)["time_unit_s"]
    shape = np.array(estimates["shape_m"]).reshape(-1, 3)
    exact = exact_map(maps, states, shape=shape, time_unit_s=time_unit_s)
    effect = true_effect(maps, states, instants)
    verdict = verdict_errors(effect, read_json(snakemake.input.verdict))
    write_table(snakemake.output.errors, estimate_errors(exact, estimates))
    write_table(snakemake.output.exact, exact.table())
    write_table(snakemake.output.verdict, verdict)
