"""Steer to the origin by the printed controller with other horizons."""

import numpy as np

from hopdata.jobs import read_table, reported, write_table
from hopdata.steering.experiments.study import horizons_of
from hopdata.steering.models.process_file import load_process
from hopdata.steering.observation.geometry import load_geometry
from hopdata.steering.trial import true_map_of

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    table = horizons_of(
        snakemake.params.steering,
        snakemake.params.motion_capture,
        model=load_process(snakemake.input.model),
        truth=true_map_of(read_table(snakemake.input.true_map)),
        geometry=load_geometry(snakemake.input.geometry),
        # The study's first seed, whose model is given.
        seed=np.random.SeedSequence(snakemake.params.seed, spawn_key=(1,)),
    )
    write_table(snakemake.output.table, table)
