"""Bootstrap the prediction errors of all models, and estimate the linear map of all landings."""

from hopdata.jobs import reported, write_json, write_table
from hopdata.landings.states.pairs import read_pairs
from hopdata.maps.corrected.estimates import estimate_maps
from hopdata.maps.prediction import bootstrap_prediction

with reported(snakemake.log[0]):
    pairs, params, output = read_pairs(snakemake.input.pairs), snakemake.params, snakemake.output
    units = {"time_unit_s": pairs.time_unit_s}
    study = bootstrap_prediction(
        *pairs.normalised(),
        pairs.schedule,
        pairs.spread_s,
        seed=params.seed,
        length_unit_m=pairs.length_unit_m,
        **units,
        **params.prediction,
    )
    write_table(output.errors, study.errors)
    write_table(output.summary, study.summary)
    write_json(output.notes, study.notes)
    estimates = estimate_maps(pairs.x, pairs.y, pairs.instants, **units)
    write_table(output.estimates, estimates.table())
    write_json(output.maps, estimates.to_dict())
    write_json(output.estimate_notes, estimates.notes)
