"""Find sections, touchdowns between them, states at both in home frames, and the units."""

from pathlib import Path

from hopdata.jobs import read_table, read_tables, reported, write_json, write_table
from hopdata.landings.contacts.velocity_minimum import example_touchdown
from hopdata.landings.sections.select import (
    section_densities,
    section_frames,
    select_sections,
)
from hopdata.landings.states.assemble import assemble_pairs, exclude_stateless
from hopdata.landings.states.pairs import write_pairs
from hopdata.landings.touchdowns import touchdown_tables
from hopdata.maps.units import choose_units
from hopdata.recording import require_distinct
from hopdata.recordings.readers.hdf5 import read_recording

with reported(snakemake.log[0]):
    source, target, params = snakemake.input, snakemake.output, snakemake.params
    recordings = [read_recording(path) for path in source.recordings]
    require_distinct(recordings)
    names = [one.name for one in recordings]
    landings = dict(zip(names, map(read_table, source.landings), strict=True))
    sections = select_sections(
        recordings, landings=landings, compare=True, **params.sections
    )
    write_json(target.sections, sections.to_dict())
    write_table(
        target.densities,
        section_densities(recordings, sections, landings, nodes=params.nodes),
    )
    write_table(target.frames, section_frames(recordings, sections))
    heights = {
        "pre_height_m": sections.pre_height_m,
        "post_height_m": sections.post_height_m,
    }
    paths, how = iter(target.labelled), {**params.touchdowns, **heights}
    for method in params.methods:
        tables = touchdown_tables(
            recordings, landings, params.exclude, **{**how, "method": method}
        )
        for table in tables:
            write_table(next(paths), table)
    mine = [one for one in target.labelled if Path(one).parent.name == how["method"]]
    table, rest = read_tables(mine), {"ambiguous": how["ambiguous"]}
    pairs = assemble_pairs(
        recordings, table, **params.home, **heights, **params.states, **rest
    )
    units = choose_units(pairs.x, pairs.y, **params.units)
    pairs = pairs.with_units(units.length_unit_m, units.time_unit_s)
    table = exclude_stateless(table, pairs)
    write_pairs(target.pairs, pairs)
    write_json(target.units, units.to_dict())
    write_table(target.touchdowns, table)
    write_table(target.example, example_touchdown(recordings, table))
