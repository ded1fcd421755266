"""Run the experiments of one manoeuvre, without and with a board."""

import numpy as np

from hopdata.jobs import read_table, reported, write_table
from hopdata.steering.experiments.study import experiments_of
from hopdata.steering.experiments.tasks import EXPERIMENTS, taking_part
from hopdata.steering.models.process_file import load_process
from hopdata.steering.observation.geometry import load_geometry
from hopdata.steering.trial import true_map_of

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    # A number, such as `1`, and a name behind it, such as `1_printed`, if the robot was
    # observed in another way than by the first of the study's observations.
    seed, _, observation = snakemake.wildcards.seed.partition("_")
    number = int(seed)
    steering = snakemake.params.steering
    asked = steering["experiments"]["controllers"]
    manoeuvre = snakemake.wildcards.manoeuvre
    names = [name for name, (kind, _) in EXPERIMENTS.items() if kind == manoeuvre]
    tables = experiments_of(
        names,
        taking_part(asked, later_observation=bool(observation)),
        steering,
        snakemake.params.motion_capture,
        model=load_process(snakemake.input.model),
        truth=true_map_of(read_table(snakemake.input.true_map)),
        geometry=load_geometry(snakemake.input.geometry),
        seed=np.random.SeedSequence(snakemake.params.seed, spawn_key=(number,)),
    )
    for name, table in tables.items():
        table.insert(0, "seed", number)
        if observation and "controller" in table:
            table["controller"] += f", {observation} observation"
        write_table(getattr(snakemake.output, name), table)
