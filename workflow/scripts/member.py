"""Run the study of one member of a group."""

from pathlib import Path

from hopdata.group import run_member
from hopdata.jobs import reported

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    folder = Path(snakemake.output.row).parent
    run_member(snakemake.params.member, folder)
