"""Compare the estimates of the landing map with the exact one."""

import numpy as np

from hopdata.jobs import read_json, reported, write_table
from hopdata.landings.pairs import read_pairs
from hopdata.maps.exact_map import estimate_errors, exact_map

with reported(snakemake.log[0]):
    estimates = read_json(snakemake.input.estimates)
    exact = exact_map(
        read_json(snakemake.input.maps),
        read_pairs(snakemake.input.true_pairs).x,
        shape=np.array(estimates["shape_m"]).reshape(-1, 3),
        time_unit_s=read_json(snakemake.input.units)["time_unit_s"],
    )
    write_table(snakemake.output.errors, estimate_errors(exact, estimates))
    write_table(snakemake.output.exact, exact.table())
