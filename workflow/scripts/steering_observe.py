"""Observe pose, boom angle and stances, and collect the frame changes."""

from hopdata.jobs import reported, write_json, write_table
from hopdata.recordings.readers.hdf5 import read_recording
from hopdata.steering.frame_changes import to_table
from hopdata.steering.observation.observe import observe_recordings

with reported(snakemake.log[0]):
    observed = observe_recordings(
        [read_recording(path) for path in snakemake.input.recordings],
        swing_limit_rad=snakemake.params.swing_limit_rad,
    )
    observed.geometry.save(snakemake.output.geometry)
    write_table(snakemake.output.changes, to_table(observed.changes))
    write_table(snakemake.output.stances, observed.stances)
    write_table(snakemake.output.motion, observed.motion)
    write_json(snakemake.output.counts, observed.counts)
