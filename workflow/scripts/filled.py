"""Count gaps and what was filled of them."""

from hopdata.jobs import reported, write_table
from hopdata.landings.filling import filled_table
from hopdata.recordings.readers.hdf5 import read_recording

with reported(snakemake.log[0]):
    recordings = map(read_recording, snakemake.input.recordings)
    write_table(snakemake.output.filled, filled_table(recordings))
