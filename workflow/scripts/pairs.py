"""Sections of a study, touchdowns between them, states at both in home frames, and the units."""

from hopdata.jobs import read_table, read_tables, reported, write_json, write_table
from hopdata.landings.contacts.velocity_minimum import example_touchdown
from hopdata.landings.filling import mark_filled
from hopdata.landings.sections.select import section_densities, section_frames
from hopdata.landings.sections.select import select_sections
from hopdata.landings.states.assemble import assemble_pairs, exclude_stateless
from hopdata.landings.states.pairs import write_pairs
from hopdata.landings.touchdowns import left_out, touchdown_table
from hopdata.maps.units import choose_units
from hopdata.recording import require_distinct
from hopdata.recordings.readers.hdf5 import read_recording

with reported(snakemake.log[0]):
    source, target, params = snakemake.input, snakemake.output, snakemake.params
    recordings = [read_recording(path) for path in source.recordings]
    require_distinct(recordings)
    landings = [read_table(path) for path in source.landings]
    named = {one.name: found for one, found in zip(recordings, landings, strict=True)}
    options = dict(params.sections)
    nodes = options.pop("grid_nodes")
    sections = select_sections(recordings, landings=named, **options)
    write_json(target.sections, sections.to_dict())
    write_table(target.densities, section_densities(recordings, sections, nodes=nodes))
    write_table(target.frames, section_frames(recordings))
    heights = {"pre_height_m": sections.pre_height_m, "post_height_m": sections.post_height_m}
    paths = iter(target.labelled)
    written = {}
    for method in params.methods:
        written[method] = [next(paths) for _ in recordings]
        for path, recording, spans in zip(written[method], recordings, params.exclude, strict=True):
            table = touchdown_table(
                recording,
                landings=named[recording.name],
                **{**params.touchdowns, **heights, "method": method},
            )
            table = mark_filled(recording, table, largest_share=params.largest_share)
            write_table(path, left_out(table, spans))
    table = read_tables(written[params.method])
    pairs = assemble_pairs(
        recordings,
        table,
        home_marker=params.home["marker"],
        ambiguous=params.touchdowns["ambiguous"],
        **heights,
        **params.states,
    )
    units = choose_units(pairs.x, pairs.y, **params.units)
    pairs = pairs.with_units(units.length_unit_m, units.time_unit_s)
    write_pairs(target.pairs, pairs)
    write_json(target.units, units.to_dict())
    table = exclude_stateless(table, pairs)
    write_table(target.touchdowns, table)
    write_table(target.example, example_touchdown(recordings, table))
