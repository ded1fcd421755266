"""Bootstrap the prediction errors of all models."""

from hopdata.jobs import reported, write_json, write_table
from hopdata.landings.pairs import read_pairs
from hopdata.maps.prediction import bootstrap_prediction, summarise_prediction

with reported(snakemake.log[0]):
    pairs = read_pairs(snakemake.input.pairs)
    errors, notes = bootstrap_prediction(
        pairs, seed=snakemake.params.seed, **snakemake.params.options
    )
    write_table(snakemake.output.errors, errors)
    write_table(snakemake.output.summary, summarise_prediction(errors, pairs))
    write_json(snakemake.output.notes, notes)
