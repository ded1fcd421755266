rule maps:
    """Fit linear maps per schedule; find prediction errors, and distances of subspaces if asked."""
    input:
        pairs=rules.pairs.output.pairs,
    output:
        **(
            {
                "distances": f"{RESULTS}/tables/distances.csv",
                "distance_summary": f"{RESULTS}/tables/distance_summary.csv",
                "distance_notes": f"{RESULTS}/maps/distances_notes.json",
            }
            if DISTANCES
            else {}
        ),
        errors=f"{RESULTS}/tables/prediction_errors.csv",
        prediction=f"{RESULTS}/tables/prediction_summary.csv",
        prediction_notes=f"{RESULTS}/maps/prediction_notes.json",
        estimates=f"{RESULTS}/tables/map_estimates.csv",
        maps=f"{RESULTS}/maps/map_estimates.json",
        estimate_notes=f"{RESULTS}/maps/map_estimates_notes.json",
    log:
        f"{RESULTS}/logs/maps.log",
    benchmark:
        f"{RESULTS}/benchmarks/maps.tsv"
    priority: 1  # more waits for it than for a figure
    resources:
        **needs(mb_a_mb=60, minutes=50),
    params:
        prediction=STUDY["prediction"],
        subspaces=STUDY["subspaces"],
        distances=STUDY["distances"],
        seed=STUDY["seed"],
        code=code("maps"),
    script:
        "../scripts/maps.py"


rule true_sections:
    """Compute the noise-free states at the sections, and the exact linear maps."""
    input:
        recordings=each_recording(f"{RESULTS}/recordings/{{recording}}.h5"),
        sections=rules.pairs.output.sections,
    output:
        pairs=f"{RESULTS}/landings/true_pairs.h5",
        maps=f"{RESULTS}/maps/exact_maps.json",
    log:
        f"{RESULTS}/logs/true_sections.log",
    benchmark:
        f"{RESULTS}/benchmarks/true_sections.tsv"
    resources:
        **needs(minutes=30),
    params:
        recordings=RECORDINGS,
        markers=STUDY["markers"],
        code=code("true_sections"),
    script:
        "../scripts/true_sections.py"


rule scaling_study:
    """Fit maps to noise-free landings with scaled-down deviations from a simultaneous contact."""
    input:
        recordings=each_recording(f"{RESULTS}/recordings/{{recording}}.h5"),
        sections=rules.pairs.output.sections,
    output:
        scaling=f"{RESULTS}/tables/scaling_study.csv",
    log:
        f"{RESULTS}/logs/scaling_study.log",
    benchmark:
        f"{RESULTS}/benchmarks/scaling_study.tsv"
    threads: 4
    resources:
        **needs(minutes=60),
    params:
        options=STUDY["scaling_study"],
        markers=STUDY["markers"],
        code=code("scaling_study"),
    script:
        "../scripts/scaling_study.py"


rule verdict:
    """Judge whether the map through the landing is C1: effect size, interval and bound."""
    input:
        pairs=rules.pairs.output.pairs,
        touchdowns=rules.pairs.output.touchdowns,
    output:
        verdict=f"{RESULTS}/verdict.json",
    log:
        f"{RESULTS}/logs/verdict.log",
    benchmark:
        f"{RESULTS}/benchmarks/verdict.tsv"
    priority: 2  # the longest stage among those with no others to wait for
    resources:
        **needs(mb_a_mb=200, minutes=60),
    params:
        options=STUDY["verdict"],
        seed=STUDY["seed"],
        code=code("verdict"),
    script:
        "../scripts/verdict.py"


rule estimate_errors:
    """Compare states, estimates of the landing map and the verdict with the truth."""
    input:
        pairs=rules.pairs.output.pairs,
        touchdowns=rules.pairs.output.touchdowns,
        recordings=each_recording(f"{RESULTS}/recordings/{{recording}}.h5"),
        estimates=rules.maps.output.maps,
        maps=rules.true_sections.output.maps,
        true_pairs=rules.true_sections.output.pairs,
        units=rules.pairs.output.units,
        verdict=rules.verdict.output.verdict,
    output:
        errors=f"{RESULTS}/tables/estimate_errors.csv",
        exact=f"{RESULTS}/tables/exact_map.csv",
        verdict=f"{RESULTS}/tables/verdict_errors.csv",
        states=f"{RESULTS}/tables/state_errors.csv",
    log:
        f"{RESULTS}/logs/estimate_errors.log",
    benchmark:
        f"{RESULTS}/benchmarks/estimate_errors.tsv"
    resources:
        **needs(minutes=10),
    params:
        recordings=RECORDINGS,
        markers=STUDY["markers"],
        code=code("estimate_errors"),
    script:
        "../scripts/estimate_errors.py"


rule score:
    """Score a study against the truth in its synthetic recordings."""
    input:
        **{
            f"{method}_{recording}": f"{RESULTS}/landings/{method}/{recording}.csv"
            for method in LABELLED_BY
            for recording in RECORDINGS
        },
        exact=(
            [
                rules.scaling_study.output.scaling,
                rules.estimate_errors.output.states,
                rules.estimate_errors.output.errors,
                rules.estimate_errors.output.verdict,
            ]
            if SIMULATED
            else []
        ),
        recordings=each_recording(f"{RESULTS}/recordings/{{recording}}.h5"),
        floors=each_recording(f"{RESULTS}/ready/{{recording}}.json"),
        sections=rules.pairs.output.sections,
        prediction=rules.maps.output.prediction,
        distances=rules.maps.output.distance_summary if DISTANCES else [],
    output:
        truth=f"{RESULTS}/truth.json",
    log:
        f"{RESULTS}/logs/score.log",
    benchmark:
        f"{RESULTS}/benchmarks/score.tsv"
    resources:
        **needs(mb_a_mb=20, minutes=10),
    params:
        methods=LABELLED_BY,
        recordings=RECORDINGS,
        markers=STUDY["markers"],
        code=code("score"),
    script:
        "../scripts/score.py"
