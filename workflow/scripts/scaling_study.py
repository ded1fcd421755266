"""Integrate scaled landings again, and fit maps to them."""

from hopdata.jobs import read_json, reported, write_table
from hopdata.maps.truth.scaling import scaling_table
from hopdata.recordings.readers.hdf5 import read_truth
from hopdata.synthesis.scaling import study_landings

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    sections = read_json(snakemake.input.sections)
    landings = study_landings(
        [read_truth(path) for path in snakemake.input.recordings],
        body=snakemake.params.markers["body"],
        pre_m=sections["pre_height_m"],
        post_m=sections["post_height_m"],
        workers=snakemake.threads,
        **snakemake.params.options,
    )
    write_table(snakemake.output.scaling, scaling_table(landings))
