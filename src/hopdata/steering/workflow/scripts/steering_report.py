"""Gather the steering study into one page."""

from pathlib import Path

from hopdata.jobs import read_json, read_table, reported, whole_file, write_json
from hopdata.provenance import provenance
from hopdata.recordings.readers.hdf5 import read_recording
from hopdata.report.inputs import read_figures
from hopdata.steering.report.page import SteeringInputs, build_steering_report

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    source = snakemake.input
    recordings = [read_recording(path) for path in source.recordings]
    stage_times = [
        Path(path) for path in snakemake.params.stage_times if Path(path).exists()
    ]
    record = provenance(
        snakemake.params.study,
        {r.source: r.source_sha256 for r in recordings},
        stage_times,
    )
    simulated = ("outcomes", "horizons", "examples")  # a recorded robot has none
    inputs = SteeringInputs(
        study=snakemake.params.study["study"],
        figures=read_figures(source.figures, source.captions),
        **{name: read_table(source[name]) for name in simulated if source.get(name)},
        counts=read_json(source.counts),
        scores=read_table(source.scores),
        truth=read_json(source.truth) if source.get("truth") else None,
        provenance=record,
    )
    write_json(snakemake.output.provenance, record)
    with whole_file(snakemake.output.report) as temporary:
        temporary.write_text(build_steering_report(inputs), encoding="utf-8")
