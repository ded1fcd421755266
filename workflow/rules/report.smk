rule figure_verdict:
    """The verdict: how different the maps of the contact orders are, and what could be seen."""
    input:
        verdict=rules.verdict.output.verdict,
        windows=rules.verdict.output.windows,
    output:
        figure("verdict"),
    log:
        f"{RESULTS}/logs/figure_verdict.log",
    benchmark:
        f"{RESULTS}/benchmarks/figure_verdict.tsv"
    params:
        options=STUDY["figures"],
        code=code("figure_verdict"),
    script:
        "../scripts/figure_verdict.py"


rule figure_quality:
    """Stability of the sections, drift, the landings to look at, and the gaps."""
    input:
        markers=rules.quality.output.markers,
        gaps=rules.quality.output.gaps,
        faults=rules.quality.output.faults,
        stability=rules.quality.output.stability,
        drift=rules.quality.output.drift,
        landings=rules.quality.output.landings,
        samples=rules.quality.output.samples,
    output:
        stability=figure("stability"),
        worst_landings=figure("worst_landings"),
        recording_gaps=figure("recording_gaps"),
    log:
        f"{RESULTS}/logs/figure_quality.log",
    benchmark:
        f"{RESULTS}/benchmarks/figure_quality.tsv"
    params:
        options=STUDY["figures"],
        code=code("figure_quality"),
    script:
        "../scripts/figure_quality.py"


rule figure_sections:
    """Fig. 2.2: foot height against body height, and the sections chosen from it."""
    input:
        frames=rules.sections.output.frames,
        densities=rules.sections.output.densities,
        sections=rules.sections.output.sections,
    output:
        figure("fig2_2_sections"),
    log:
        f"{RESULTS}/logs/figure_sections.log",
    benchmark:
        f"{RESULTS}/benchmarks/figure_sections.tsv"
    params:
        options=STUDY["figures"],
        code=code("figure_sections"),
    script:
        "../scripts/figure_sections.py"


rule figure_schedule:
    """Fig. 2.3: one touchdown, its contact instants and their order."""
    input:
        example=rules.pairs.output.example,
        touchdowns=rules.pairs.output.touchdowns,
    output:
        figure("fig2_3_schedule"),
    log:
        f"{RESULTS}/logs/figure_schedule.log",
    benchmark:
        f"{RESULTS}/benchmarks/figure_schedule.tsv"
    params:
        options=STUDY["figures"],
        code=code("figure_schedule"),
    script:
        "../scripts/figure_schedule.py"


rule figure_prediction:
    """Fig. 2.4: bootstrapped prediction errors."""
    input:
        summary=rules.prediction.output.summary,
        units=rules.units.output.units,
    output:
        figure("fig2_4_prediction"),
    log:
        f"{RESULTS}/logs/figure_prediction.log",
    benchmark:
        f"{RESULTS}/benchmarks/figure_prediction.tsv"
    params:
        options=STUDY["figures"],
        code=code("figure_prediction"),
    script:
        "../scripts/figure_prediction.py"


rule figure_distances:
    """Fig. 2.5: arc lengths within and between schedules."""
    input:
        distances=rules.distances.output.distances,
        summary=rules.distances.output.summary,
    output:
        figure("fig2_5_distances"),
    log:
        f"{RESULTS}/logs/figure_distances.log",
    benchmark:
        f"{RESULTS}/benchmarks/figure_distances.tsv"
    params:
        options=STUDY["figures"],
        code=code("figure_distances"),
    script:
        "../scripts/figure_distances.py"


rule figure_map_matrices:
    """The landing map as printed and corrected, beside the exact one where that is known."""
    input:
        estimates=rules.map_estimates.output.table,
        exact=([rules.estimate_errors.output.exact] if SIMULATED else []),
    output:
        figure("map_matrices"),
    log:
        f"{RESULTS}/logs/figure_map_matrices.log",
    benchmark:
        f"{RESULTS}/benchmarks/figure_map_matrices.tsv"
    params:
        options=STUDY["figures"],
        code=code("figure_map_matrices"),
    script:
        "../scripts/figure_map_matrices.py"


rule figure_sensitivity:
    """How distances between subspaces answer to noise."""
    input:
        sensitivity=rules.sensitivity.output.sensitivity,
        readings=rules.sensitivity.output.readings,
        summary=rules.distances.output.summary,
    output:
        figure("distance_sensitivity"),
    log:
        f"{RESULTS}/logs/figure_sensitivity.log",
    benchmark:
        f"{RESULTS}/benchmarks/figure_sensitivity.tsv"
    params:
        options=STUDY["figures"],
        code=code("figure_sensitivity"),
    script:
        "../scripts/figure_sensitivity.py"


rule figure_map_errors:
    """Errors of fitted maps by the number of landings."""
    input:
        errors=rules.map_errors.output.errors,
    output:
        figure("map_errors"),
    log:
        f"{RESULTS}/logs/figure_map_errors.log",
    benchmark:
        f"{RESULTS}/benchmarks/figure_map_errors.tsv"
    params:
        options=STUDY["figures"],
        code=code("figure_map_errors"),
    script:
        "../scripts/figure_map_errors.py"


rule figure_scaling_study:
    """The scaling study: the hopper and three kinds of control side by side."""
    input:
        scaling=rules.scaling_study.output.scaling,
    output:
        figure("scaling_study"),
    log:
        f"{RESULTS}/logs/figure_scaling_study.log",
    benchmark:
        f"{RESULTS}/benchmarks/figure_scaling_study.tsv"
    params:
        options=STUDY["figures"],
        code=code("figure_scaling_study"),
    script:
        "../scripts/figure_scaling_study.py"


# What a study runs through, whose times the report gives.
STAGES = [
    *([] if all(SOURCES.values()) else [rules.simulate]),
    rules.import_recording,
    rules.level,
    *([rules.fill, rules.filled] if FILLS else []),
    rules.sections,
    rules.touchdowns,
    *([rules.compared_touchdowns] if COMPARED_METHODS else []),
    rules.pairs,
    rules.quality,
    rules.figure_quality,
    rules.units,
    rules.prediction,
    rules.subspaces,
    rules.distances,
    rules.verdict,
    rules.score,
    rules.figure_verdict,
    rules.figure_sections,
    rules.figure_schedule,
    rules.figure_prediction,
    rules.figure_distances,
    rules.map_estimates,
    rules.figure_map_matrices,
    *([rules.sensitivity, rules.figure_sensitivity] if STUDY["distances"]["sensitivity"] else []),
    *(
        [
            rules.true_sections,
            rules.map_errors,
            rules.estimate_errors,
            rules.scaling_study,
            rules.figure_map_errors,
            rules.figure_scaling_study,
        ]
        if SIMULATED
        else []
    ),
    *([rules.contact_overlay, rules.figure_contact_overlay] if EXTERNAL else []),
]


# Whether the study's page has the sections of the steering.
IN_REPORT = STUDY["steering"]["in_report"]


rule report:
    """One page with everything, and where it comes from."""
    input:
        **(
            {f"steering_{name}": files for name, files in STEERING_PAGE.items()}
            if IN_REPORT
            else {}
        ),
        figures=FIGURES,
        captions=expand(f"{CAPTIONS}/{{name}}.md", name=FIGURE_NAMES),
        recordings=each_recording(f"{RESULTS}/recordings/{{recording}}.h5"),
        floors=each_recording(f"{RESULTS}/level/{{recording}}.json"),
        filled=[rules.filled.output.filled] if FILLS else [],
        sections=rules.sections.output.sections,
        touchdowns=rules.pairs.output.touchdowns,
        units=rules.units.output.units,
        prediction=rules.prediction.output.summary,
        distances=rules.distances.output.summary,
        verdict=rules.verdict.output.verdict,
        quality=rules.quality.output.checks,
        faults=rules.quality.output.faults,
        remarks=rules.quality.output.remarks,
        notes=[
            rules.prediction.output.notes,
            rules.subspaces.output.notes,
            rules.distances.output.notes,
            rules.map_estimates.output.notes,
        ],
        truth=rules.score.output.truth,
        overlay=(
            [
                rules.contact_overlay.output.summary,
                rules.contact_overlay.output.contacts,
                rules.contact_overlay.output.thresholds,
            ]
            if EXTERNAL
            else []
        ),
    output:
        report=f"{RESULTS}/report.html",
        provenance=f"{RESULTS}/provenance.json",
    log:
        f"{RESULTS}/logs/report.log",
    params:
        study=STUDY,
        stage_times=sorted(
            set(
                expand(
                    [stage.benchmark for stage in STAGES + (STEERING_STAGES if IN_REPORT else [])],
                    recording=RECORDINGS,
                    experiment=EXPERIMENTS,
                )
            )
        ),
        code=code("report"),
    script:
        "../scripts/report.py"
