"""Gather a study into one page."""

from pathlib import Path

from hopdata.config.loading import what_is_set
from hopdata.jobs import read_json, read_table, reported, whole_file, write_json
from hopdata.provenance import provenance
from hopdata.recordings.readers.hdf5 import read_recording
from hopdata.report.inputs import ReportInputs, describe_recording, read_figures
from hopdata.report.page import build_report

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    source = snakemake.input
    config = snakemake.params.study
    recordings = []
    digests = {}
    for path in source.recordings:  # one by one, so that none stays in memory
        recording = read_recording(path)
        recordings.append(describe_recording(recording))
        digests[recording.source] = recording.source_sha256
    names = [one["name"] for one in recordings]
    floors = [read_json(path) for path in source.floors]
    times = [Path(path) for path in snakemake.params.stage_times]
    record = provenance(config, digests, [path for path in times if path.exists()])
    notes = []
    for path in source.notes:
        notes += read_json(path)
    # Files that only some studies have.
    filled = read_table(source.filled) if source.filled else None
    truth = read_json(source.truth) if source.truth else None
    distances = read_table(source.distances) if source.distances else None
    page = build_report(
        ReportInputs(
            study=config["study"],
            language=config["report"]["language"],
            figures=read_figures(source.figures, source.captions),
            recordings=recordings,
            levelled=[read_recording(path) for path in source.levelled],
            filled=filled,
            sections=read_json(source.sections),
            units=read_json(source.units),
            provenance=record,
            floors=dict(zip(names, floors, strict=True)),
            truth=truth,
            distances=distances,
            distances_asked=config["distances"]["enabled"],
            verdict=read_json(source.verdict),
            overlay={Path(path).stem: read_table(path) for path in source.overlay},
            quality=read_json(source.quality),
            touchdowns=read_table(source.touchdowns),
            lags=read_table(source.lags),
            prediction=read_table(source.prediction),
            faults=read_table(source.faults),
            remarks=read_table(source.remarks),
            one_or_own=read_table(source.one_or_own),
            settings=what_is_set(config),
            notes=notes,
        )
    )
    write_json(snakemake.output.provenance, record)
    with whole_file(snakemake.output.report) as draft:
        draft.write_text(page, encoding="utf-8")
