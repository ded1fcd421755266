"""Score a study against the truth in its synthetic recordings."""

from pathlib import Path

from hopdata.jobs import read_json, read_table, reported, write_json
from hopdata.landings.floor_surface import FloorModel
from hopdata.maps.truth.scoring import score
from hopdata.recordings.readers.hdf5 import read_recording, read_truth
from hopdata.synthesis.scaling import UNKNOWN

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    source = snakemake.input
    files = dict(zip(snakemake.params.recordings, source.recordings, strict=True))
    truths = {name: read_truth(path) for name, path in files.items()}
    models = dict(zip(snakemake.params.recordings, source.floors, strict=True))
    distances = None
    if source.distances:
        distances = read_table(source.distances)
    without_exact_maps = ""
    if source.maps:
        without_exact_maps = read_json(source.maps).get(UNKNOWN, "")
    entries = score(
        {name: truth for name, truth in truths.items() if truth is not None},
        floors={
            name: FloorModel.from_dict(read_json(path)) for name, path in models.items()
        },
        feet=snakemake.params.markers["feet"],
        tables={Path(path).stem: read_table(path) for path in source.schedules},
        sections=read_json(source.sections),
        recordings={name: read_recording(path) for name, path in files.items()},
        prediction_summary=read_table(source.prediction),
        distance_summary=distances,
        exact={Path(path).stem: read_table(path) for path in source.exact},
        without_exact_maps=without_exact_maps,
    )
    write_json(snakemake.output.truth, entries)
