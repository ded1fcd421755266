"""Import and level one recording, fill its gaps, and find its contacts."""

from hopdata.jobs import logger, reported, write_json, write_table
from hopdata.landings.contacts.find import find_landings
from hopdata.landings.contacts.joined import join_feet
from hopdata.landings.filling import fill_gaps
from hopdata.landings.floor import fit_floor, level
from hopdata.recordings.importing import import_recording
from hopdata.recordings.plausibility import check_plausible, notes
from hopdata.recordings.readers.hdf5 import read_recording, write_recording

with reported(snakemake.log[0]):
    params = snakemake.params
    recording, truth = import_recording(
        list(snakemake.input),
        name=snakemake.wildcards.recording,
        markers=params.markers,
        exclude=params.exclude,
        **params.options,
    )
    check_plausible(recording, **params.quality)
    for note in notes(recording):
        logger.warning("%s", note)
    floor = fit_floor(recording, **params.floor)
    write_recording(snakemake.output.recording, recording, truth=truth)
    ready = level(recording, floor, overwrite=True)  # memory may hold one copy only
    ready = join_feet(ready, params.feet)
    if params.fills:
        ready = fill_gaps(ready, longest_s=params.longest_s, overwrite=True)
    write_recording(snakemake.output.ready, ready)
    write_json(snakemake.output.floor, floor.to_dict())
    del (
        recording,
        truth,
        ready,
    )  # free the memory, then read the recording as later stages do
    ready = read_recording(snakemake.output.ready)
    write_table(snakemake.output.landings, find_landings(ready, **params.contacts))
