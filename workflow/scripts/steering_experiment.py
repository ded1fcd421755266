"""Run one experiment for all controllers from all starts."""

from hopdata.jobs import read_table, reported, write_table
from hopdata.steering.models.process import load_process
from hopdata.steering.observation.geometry import load_geometry
from hopdata.steering.experiments.study import experiment_of
from hopdata.steering.trial import true_map_of

with reported(snakemake.log[0]):
    tables = experiment_of(
        snakemake.wildcards.experiment,
        snakemake.params.steering,
        snakemake.params.motion_capture,
        models=[load_process(path) for path in snakemake.input.models],
        truth=true_map_of(read_table(snakemake.input.true_map)),
        geometry=load_geometry(snakemake.input.geometry),
        seed=snakemake.params.seed,
    )
    for name in ("runs", "stances", "example", "film"):
        write_table(getattr(snakemake.output, name), getattr(tables, name))
