"""Choose the two Poincare sections of a study."""

from hopdata.jobs import reported, write_json, write_table
from hopdata.landings.sections import section_densities, section_frames, select_sections
from hopdata.recordings.hdf5 import read_recording

with reported(snakemake.log[0]):
    recordings = [read_recording(path) for path in snakemake.input.recordings]
    sections = select_sections(recordings, **snakemake.params.options)
    nodes = snakemake.params.options["grid_nodes"]
    write_json(snakemake.output.sections, sections.to_dict())
    write_table(
        snakemake.output.densities, section_densities(recordings, sections, nodes=nodes)
    )
    write_table(snakemake.output.frames, section_frames(recordings))
