"""Find the descents of one recording and the contact instants in them."""

from hopdata.jobs import reported, write_table
from hopdata.landings.contacts.find import find_landings
from hopdata.recordings.readers.hdf5 import read_recording

with reported(snakemake.log[0]):
    recording = read_recording(snakemake.input.recording)
    landings = find_landings(recording, **snakemake.params.options)
    write_table(snakemake.output.landings, landings)
