"""How many hops it takes to learn the frame change, and whether the kernel matters."""

from hopdata.jobs import read_table, reported, write_table
from hopdata.steering.frame_changes import from_table
from hopdata.steering.models.learning import learning_tables

with reported(snakemake.log[0]):
    tables = learning_tables(
        from_table(read_table(snakemake.input.changes)),
        training_hops=snakemake.params.model["training_hops"],
        draws=snakemake.params.model["draws"],
        seed=snakemake.params.seed,
    )
    write_table(snakemake.output.curve, tables.curve)
    write_table(snakemake.output.kernels, tables.kernels)
