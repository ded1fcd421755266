"""Run the study of one member of a group."""

from pathlib import Path

from hopdata.group import run_member
from hopdata.jobs import reported

folder = Path(snakemake.output.row).parent
with reported(snakemake.log[0], snakemake.input, snakemake.output, folder):
    run_member(snakemake.params.member, folder)
