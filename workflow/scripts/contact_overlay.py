"""Compare the contacts found with those known from other sources."""

from hopdata.jobs import read_table, reported, write_table
from hopdata.landings.external_truth import overlay_external_truth
from hopdata.recordings.readers.hdf5 import read_recording

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    overlay = overlay_external_truth(
        [read_recording(path) for path in snakemake.input.recordings],
        read_table(snakemake.input.touchdowns),
        snakemake.params.configured,
        window_s=snakemake.params.external["window_s"],
        rate_hz=snakemake.params.rate_hz,
        unit=snakemake.params.unit,
    )
    write_table(snakemake.output.contacts, overlay.contacts)
    write_table(snakemake.output.summary, overlay.summary)
    write_table(snakemake.output.thresholds, overlay.thresholds)
    write_table(snakemake.output.example, overlay.example)
    write_table(snakemake.output.notes, overlay.notes)
