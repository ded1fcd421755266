"""Bootstrap prediction errors and constraint subspaces, and estimate the map of all landings."""

from hopdata.jobs import reported, write_json, write_table
from hopdata.landings.states.pairs import read_pairs
from hopdata.maps.corrected.estimates import estimate_maps
from hopdata.maps.prediction import bootstrap_prediction
from hopdata.maps.subspaces import bootstrap_subspaces, measure_distances

with reported(snakemake.log[0]):
    pairs, params, output = (
        read_pairs(snakemake.input.pairs),
        snakemake.params,
        snakemake.output,
    )
    states, seed = (*pairs.normalised(), pairs.schedule), {"seed": params.seed}
    units = {"time_unit_s": pairs.time_unit_s}
    lengths = {"length_unit_m": pairs.length_unit_m}
    study = bootstrap_prediction(
        *states, pairs.spread_s, **seed, **units, **lengths, **params.prediction
    )
    write_table(output.errors, study.errors)
    write_table(output.prediction, study.summary)
    write_json(output.prediction_notes, study.notes)
    estimates = estimate_maps(pairs.x, pairs.y, pairs.instants, **units)
    write_table(output.estimates, estimates.table())
    write_json(output.maps, estimates.to_dict())
    write_json(output.estimate_notes, estimates.notes)
    if params.distances["enabled"]:
        options = {
            key: value for key, value in params.distances.items() if key != "enabled"
        }
        subspaces = bootstrap_subspaces(*states, **seed, **params.subspaces)
        options |= {"streams": subspaces.streams, **seed}
        apart = measure_distances(subspaces.bases, subspaces.shape, **options)
        write_table(output.distances, apart.distances)
        write_table(output.distance_summary, apart.summary)
        write_json(output.distance_notes, subspaces.notes + apart.notes)
