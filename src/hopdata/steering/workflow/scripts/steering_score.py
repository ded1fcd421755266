"""Score pose, boom angle, stances and model against the truth of the simulation."""

from hopdata.jobs import read_table, reported, write_json
from hopdata.steering.experiments.outcomes import truth_entries
from hopdata.steering.models.process_file import load_process
from hopdata.steering.trial import true_map_of

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    source = snakemake.input
    write_json(
        snakemake.output.truth,
        truth_entries(
            read_table(source.motion),
            read_table(source.true_motion),
            read_table(source.stances),
            read_table(source.true_stances),
            load_process(source.model),
            true_map_of(read_table(source.true_map)),
        ),
    )
