"""Gather the experiments: outcomes with intervals, all trajectories, the typical runs."""

from hopdata.jobs import read_tables, reported, write_table
from hopdata.steering.experiments.outcomes import outcome_table

with reported(snakemake.log[0]):
    runs = read_tables(snakemake.input.runs)
    write_table(
        snakemake.output.outcomes,
        outcome_table(runs, seed=snakemake.params.seed, confidence=snakemake.params.confidence),
    )
    write_table(snakemake.output.runs, runs)
    write_table(snakemake.output.trajectories, read_tables(snakemake.input.stances))
    write_table(snakemake.output.examples, read_tables(snakemake.input.examples))
