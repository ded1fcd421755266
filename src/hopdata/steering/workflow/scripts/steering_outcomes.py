"""Gather the experiments of all seeds: outcomes, trajectories, typical runs."""

from hopdata.jobs import read_tables, reported, write_table
from hopdata.steering.experiments.outcomes import outcome_table

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    source = snakemake.input
    output = snakemake.output
    runs = read_tables(source.runs)
    write_table(output.runs, runs)
    write_table(output.outcomes, outcome_table(runs))
    write_table(output.trajectories, read_tables(source.stances))
    write_table(output.examples, read_tables(source.examples))
    write_table(output.scores, read_tables(source.scores))
