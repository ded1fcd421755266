"""Bring one recording into the form that the analysis reads."""

from hopdata.jobs import logger, reported
from hopdata.recordings.readers.hdf5 import write_recording
from hopdata.recordings.importing import import_recording
from hopdata.recordings.plausibility import check_plausible
from hopdata.recordings.plausibility import notes

with reported(snakemake.log[0]):
    recording, truth = import_recording(
        list(snakemake.input),
        name=snakemake.wildcards.recording,
        markers=snakemake.params.markers,
        **snakemake.params.options,
    )
    check_plausible(recording, **snakemake.params.quality)
    for note in notes(recording):
        logger.warning("%s", note)
    write_recording(snakemake.output.recording, recording, truth=truth)
