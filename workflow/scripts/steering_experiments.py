"""Run the experiments of one manoeuvre, with free ground and a board, for all controllers."""

import numpy as np

from hopdata.jobs import read_table, reported, write_table
from hopdata.steering.experiments.study import experiments_of
from hopdata.steering.experiments.tasks import CEILING, EXPERIMENTS, LEARNED
from hopdata.steering.models.process import load_process
from hopdata.steering.observation.geometry import load_geometry
from hopdata.steering.trial import true_map_of

with reported(snakemake.log[0]):
    seed, _, observation = snakemake.wildcards.seed.partition("_")
    number, steering = int(seed), snakemake.params.steering
    controllers = [*steering["experiments"]["controllers"], CEILING]
    if observation:  # later observations run only the controllers that depend on them
        controllers = [name for name in controllers if name in LEARNED]
    manoeuvre = snakemake.wildcards.manoeuvre
    tables = experiments_of(
        [name for name, (asked, _) in EXPERIMENTS.items() if asked == manoeuvre],
        controllers,
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
