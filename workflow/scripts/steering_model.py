"""Learn the frame change from some of the hops, and test it on the others."""

from hopdata.jobs import read_table, reported, write_table
from hopdata.steering.frame_changes import from_table
from hopdata.steering.models.learning import map_table, training_table
from hopdata.steering.models.process import save_process
from hopdata.steering.models.learning import learn

with reported(snakemake.log[0]):
    processes, scores = learn(
        from_table(read_table(snakemake.input.changes)),
        snakemake.params.model,
        seed=snakemake.params.seed,
    )
    for path, process in zip(snakemake.output.models, processes, strict=True):
        save_process(path, process)
    write_table(snakemake.output.scores, scores)
    write_table(snakemake.output.map, map_table(processes[0], snakemake.params.swing_limit_rad))
    write_table(snakemake.output.training, training_table(processes[0]))
