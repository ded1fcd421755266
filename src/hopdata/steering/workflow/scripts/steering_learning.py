"""Tabulate the learned map, how many hops it takes, and the effect of the kernel."""

from hopdata.jobs import read_table, reported, write_table
from hopdata.steering.frame_changes import from_table
from hopdata.steering.models.learning import (
    learning_tables,
    map_table,
    printed_map_table,
    training_table,
)
from hopdata.steering.models.process_file import load_process

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    process = load_process(snakemake.input.model)
    output = snakemake.output
    largest = snakemake.params.model["map_swing_rad"]
    if largest is None:
        largest = snakemake.params.swing_limit_rad
    write_table(output.map, map_table(process, largest))
    write_table(output.printed_map, printed_map_table(process))
    write_table(output.training, training_table(process))
    curve, kernels = learning_tables(
        from_table(read_table(snakemake.input.changes)),
        training_hops=snakemake.params.model["training_hops"],
        draws=snakemake.params.model["draws"],
        seed=snakemake.params.seed,
    )
    write_table(output.curve, curve)
    write_table(output.kernels, kernels)
