"""Make one part of the page on the dissertation."""

from pathlib import Path

from hopdata.dissertation.making import make_part_apart
from hopdata.jobs import reported

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    make_part_apart(
        snakemake.params.part,
        Path(snakemake.output.record).parent,
        seed=snakemake.params.seed,
        repetitions=snakemake.params.repetitions,
        log=snakemake.log[0],
        **snakemake.params.figures,
    )
