"""Gather a study into one page."""

from pathlib import Path

from hopdata.jobs import read_json, read_table, reported, whole_file, write_json
from hopdata.provenance import provenance
from hopdata.recordings.readers.hdf5 import read_recording
from hopdata.report.inputs import ReportInputs, describe_recording, read_figures
from hopdata.report.page import build_report

TABLES = ("touchdowns", "prediction", "faults", "remarks")

with reported(snakemake.log[0]):
    source = snakemake.input
    read = map(
        read_recording, source.recordings
    )  # lazy, so that no recording stays in memory
    facts = [(describe_recording(r), r.source, r.source_sha256) for r in read]
    recordings, names = [one for one, *_ in facts], [one["name"] for one, *_ in facts]
    stage_times = [
        Path(path) for path in snakemake.params.stage_times if Path(path).exists()
    ]
    digests = {file: sha256 for _, file, sha256 in facts}
    record = provenance(snakemake.params.study, digests, stage_times)
    page = build_report(
        ReportInputs(
            study=snakemake.params.study["study"],
            language=snakemake.params.study["report"]["language"],
            figures=read_figures(source.figures, source.captions),
            recordings=recordings,
            levelled=[read_recording(path) for path in source.levelled],
            filled=read_table(source.filled[0]) if source.filled else None,
            sections=read_json(source.sections),
            units=read_json(source.units),
            provenance=record,
            floors=dict(zip(names, map(read_json, source.floors), strict=True)),
            truth=read_json(source.truth) if source.truth else None,
            distances=read_table(source.distances) if source.distances else None,
            distances_asked=snakemake.params.study["distances"]["enabled"],
            verdict=read_json(source.verdict),
            overlay={Path(path).stem: read_table(path) for path in source.overlay},
            quality=read_json(source.quality),
            **{name: read_table(getattr(source, name)) for name in TABLES},
            notes=[note for path in source.notes for note in read_json(path)],
        )
    )
    write_json(snakemake.output.provenance, record)
    with whole_file(snakemake.output.report) as temporary:
        temporary.write_text(page, encoding="utf-8")
