# Studies whose truth is known: what the stages found is compared with it.
rule true_sections:
    """Compute the noise-free states at the sections, and the exact linear maps."""
    input:
        recordings=each_recording(f"{RESULTS}/recordings/{{recording}}.h5"),
        sections=f"{RESULTS}/sections.json",
    output:
        pairs=f"{RESULTS}/true_pairs.h5",
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
        sections=f"{RESULTS}/sections.json",
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


rule estimate_errors:
    """Compare states, estimates of the landing map and the verdict with the truth."""
    input:
        pairs=f"{RESULTS}/pairs.h5",
        touchdowns=f"{RESULTS}/tables/touchdowns.csv",
        recordings=each_recording(f"{RESULTS}/recordings/{{recording}}.h5"),
        estimates=f"{RESULTS}/maps/map_estimates.json",
        maps=f"{RESULTS}/maps/exact_maps.json",
        true_pairs=f"{RESULTS}/true_pairs.h5",
        units=f"{RESULTS}/units.json",
        verdict=f"{RESULTS}/verdict.json",
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
        schedules=expand(f"{RESULTS}/schedules/{{method}}.csv", method=LABELLED_BY),
        exact=(
            [
                f"{RESULTS}/tables/scaling_study.csv",
                f"{RESULTS}/tables/state_errors.csv",
                f"{RESULTS}/tables/estimate_errors.csv",
                f"{RESULTS}/tables/verdict_errors.csv",
            ]
            if SIMULATED
            else []
        ),
        maps=f"{RESULTS}/maps/exact_maps.json" if SIMULATED else [],
        recordings=each_recording(f"{RESULTS}/recordings/{{recording}}.h5"),
        floors=each_recording(f"{RESULTS}/level/{{recording}}.json"),
        sections=f"{RESULTS}/sections.json",
        prediction=f"{RESULTS}/tables/prediction_summary.csv",
        distances=f"{RESULTS}/tables/distance_summary.csv" if DISTANCES else [],
    output:
        truth=f"{RESULTS}/truth.json",
    log:
        f"{RESULTS}/logs/score.log",
    benchmark:
        f"{RESULTS}/benchmarks/score.tsv"
    resources:
        **needs(mb_a_mb=20, minutes=10),
    params:
        recordings=RECORDINGS,
        markers=STUDY["markers"],
        code=code("score"),
    script:
        "../scripts/score.py"
