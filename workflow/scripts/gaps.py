"""Count gaps and what was filled of them, and look for exchanged names."""

from hopdata.jobs import reported, write_json, write_table
from hopdata.landings.gap_table import gap_table
from hopdata.recordings.hdf5 import read_recording
from hopdata.recordings.quality.swap_notes import swap_notes

with reported(snakemake.log[0]):
    recordings = map(read_recording, snakemake.input.recordings)
    write_table(snakemake.output.gaps, gap_table(recordings))
    measured = map(read_recording, snakemake.input.measured)
    write_json(snakemake.output.notes, [note for r in measured for note in swap_notes(r)])
