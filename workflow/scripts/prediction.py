"""Bootstrap the prediction errors of all models."""

from hopdata.jobs import reported, write_json, write_table
from hopdata.landings.states.pairs import read_pairs
from hopdata.maps.prediction import bootstrap_prediction

with reported(snakemake.log[0]):
    pairs = read_pairs(snakemake.input.pairs)
    study = bootstrap_prediction(
        *pairs.normalised(),
        pairs.schedule,
        pairs.spread_s,
        seed=snakemake.params.seed,
        length_unit_m=pairs.length_unit_m,
        time_unit_s=pairs.time_unit_s,
        **snakemake.params.options,
    )
    write_table(snakemake.output.errors, study.errors)
    write_table(snakemake.output.summary, study.summary)
    write_json(snakemake.output.notes, study.notes)
