"""Score a study against the truth in its synthetic recordings."""

from pathlib import Path

from hopdata.jobs import read_json, read_table, reported, write_json
from hopdata.landings.floor_surface import FloorModel
from hopdata.maps.truth.scoring import score
from hopdata.recordings.readers.hdf5 import read_recording, read_truth

with reported(snakemake.log[0]):
    source = snakemake.input
    truths = dict(
        zip(
            snakemake.params.recordings, map(read_truth, source.recordings), strict=True
        )
    )
    floors = [FloorModel.from_dict(read_json(path)) for path in source.floors]
    tables = {Path(path).stem: read_table(path) for path in source.schedules}
    entries = score(
        {name: truth for name, truth in truths.items() if truth is not None},
        floors=dict(zip(truths, floors, strict=True)),
        feet=snakemake.params.markers["feet"],
        tables=tables,
        sections=read_json(source.sections),
        recordings={
            name: read_recording(path)
            for name, path in zip(truths, source.recordings, strict=True)
        },
        prediction_summary=read_table(source.prediction),
        distance_summary=read_table(source.distances) if source.distances else None,
        exact={Path(path).stem: read_table(path) for path in source.exact},
    )
    write_json(snakemake.output.truth, entries)
