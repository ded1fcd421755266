"""Gather the steering study into one page."""

from pathlib import Path

from hopdata.jobs import reported, whole_file, write_json
from hopdata.provenance import provenance
from hopdata.recordings.readers.hdf5 import read_recording
from hopdata.report.steering import build_steering_report, read_steering

with reported(snakemake.log[0]):
    recordings = [read_recording(path) for path in snakemake.input.recordings]
    stage_times = [Path(path) for path in snakemake.params.stage_times if Path(path).exists()]
    record = provenance(
        snakemake.params.study, {r.source: r.source_sha256 for r in recordings}, stage_times
    )
    inputs = read_steering(
        snakemake.params.study["study"], dict(snakemake.input.items()), provenance=record
    )
    write_json(snakemake.output.provenance, record)
    with whole_file(snakemake.output.report) as temporary:
        temporary.write_text(build_steering_report(inputs), encoding="utf-8")
