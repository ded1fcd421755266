"""Choose the two Poincare sections of a study."""

from hopdata.jobs import reported, write_json, write_table
from hopdata.landings.sections.select import section_densities, section_frames
from hopdata.landings.sections.select import select_sections
from hopdata.recording import require_distinct
from hopdata.recordings.readers.hdf5 import read_recording

with reported(snakemake.log[0]):
    recordings = [read_recording(path) for path in snakemake.input.recordings]
    require_distinct(recordings)
    options = dict(snakemake.params.options)
    nodes = options.pop("grid_nodes")
    sections = select_sections(recordings, **options)
    write_json(snakemake.output.sections, sections.to_dict())
    write_table(snakemake.output.densities, section_densities(recordings, sections, nodes=nodes))
    write_table(snakemake.output.frames, section_frames(recordings))
