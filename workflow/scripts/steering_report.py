"""Gather the steering study into one page."""

from hopdata.jobs import reported, whole_file, write_json
from hopdata.provenance import provenance_of_files
from hopdata.report.steering import build_steering_report, read_steering

with reported(snakemake.log[0]):
    record = provenance_of_files(
        snakemake.params.study, snakemake.input.recordings, snakemake.params.stage_times
    )
    inputs = read_steering(
        snakemake.params.study["study"], dict(snakemake.input.items()), provenance=record
    )
    write_json(snakemake.output.provenance, record)
    with whole_file(snakemake.output.report) as temporary:
        temporary.write_text(build_steering_report(inputs), encoding="utf-8")
