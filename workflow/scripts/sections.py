"""Choose the two Poincare sections of a study; tabulate the touchdowns between them."""

from hopdata.jobs import read_table, reported, write_json, write_table
from hopdata.landings.filling import mark_filled
from hopdata.landings.sections.select import section_densities, section_frames
from hopdata.landings.sections.select import select_sections
from hopdata.landings.touchdowns import left_out, touchdown_table
from hopdata.recording import require_distinct
from hopdata.recordings.readers.hdf5 import read_recording

with reported(snakemake.log[0]):
    source, target, params = snakemake.input, snakemake.output, snakemake.params
    recordings = [read_recording(path) for path in source.recordings]
    require_distinct(recordings)
    landings = [read_table(path) for path in source.landings]
    named = {one.name: found for one, found in zip(recordings, landings, strict=True)}
    options = dict(params.options)
    nodes = options.pop("grid_nodes")
    sections = select_sections(recordings, landings=named, **options)
    write_json(target.sections, sections.to_dict())
    write_table(target.densities, section_densities(recordings, sections, nodes=nodes))
    write_table(target.frames, section_frames(recordings))
    paths = iter(target.touchdowns)
    for method in params.methods:
        for recording, spans in zip(recordings, params.exclude, strict=True):
            table = touchdown_table(
                recording,
                landings=named[recording.name],
                pre_height_m=sections.pre_height_m,
                post_height_m=sections.post_height_m,
                **{**params.touchdowns, "method": method},
            )
            table = mark_filled(recording, table, largest_share=params.largest_share)
            write_table(next(paths), left_out(table, spans))
