"""Compare measured states and fitted maps with the true ones."""

from hopdata.jobs import read_json, read_table, reported, write_table
from hopdata.landings.pair_files import read_pairs
from hopdata.maps.truth.map_errors import map_error_table
from hopdata.maps.truth.state_errors import state_errors, true_rows
from hopdata.recordings.hdf5 import read_truth

with reported(snakemake.log[0]):
    source, output, names = snakemake.input, snakemake.output, snakemake.params.recordings
    pairs, true = read_pairs(source.pairs), read_pairs(source.true_pairs)
    contacts = {
        name: read_truth(path).contact_times
        for name, path in zip(names, source.recordings, strict=True)
    }
    table, exact = read_table(source.touchdowns), read_json(source.maps)
    time_unit_s = read_json(source.units)["time_unit_s"]
    rows = true_rows(pairs, table, true, contacts, snakemake.params.markers["feet"])
    seed = snakemake.params.seed
    errors = map_error_table(pairs, true, rows, exact, time_unit_s=time_unit_s, seed=seed)
    write_table(output.errors, errors)
    write_table(output.states, state_errors(pairs, true, rows))
