"""Measure the quality of recordings and landings."""

from hopdata.jobs import read_json, read_table, reported, write_json, write_table
from hopdata.landings.checks import check_study
from hopdata.landings.filling import filled_table
from hopdata.landings.sections.select import Sections
from hopdata.landings.stability import drift_table, section_stability
from hopdata.recordings.readers.hdf5 import read_recording

with reported(snakemake.log[0]):
    source, target, params = snakemake.input, snakemake.output, snakemake.params
    levelled = [read_recording(path) for path in source.levelled]
    touchdowns = read_table(source.touchdowns)
    sections = Sections.from_dict(read_json(source.sections))
    landings = zip(levelled, map(read_table, source.landings), strict=True)
    landings = {recording.name: table for recording, table in landings}
    options = {
        key: value for key, value in params.sections.items() if key != "grid_nodes"
    }
    tables = {
        "stability": section_stability(levelled, sections, options, landings),
        "drift": drift_table(levelled, touchdowns),
        "filled": filled_table(levelled),
    }
    checks = check_study(
        touchdowns=touchdowns,
        markers=read_table(source.markers),
        faults=read_table(source.faults),
        expected_noise_m=params.noise_m,
        floors=dict(zip(landings, map(read_json, source.floors), strict=True)),
        other_feet=options["frames"] == "landings",
        **{name: tables[name] for name in ("stability", "drift")},
    )
    write_json(target.checks, [check.to_dict() for check in checks])
    for name, path in target.items():
        if name != "checks":
            write_table(path, tables[name])
