# What a study runs through, whose times the report gives.
STAGES = [
    *([] if all(SOURCES.values()) else [rules.simulate]),
    rules.recording,
    rules.sections,
    rules.touchdowns,
    rules.pairs,
    rules.quality,
    rules.linear_maps,
    rules.distances,
    rules.verdict,
    rules.score,
    *(
        [rules.true_sections, rules.map_errors, rules.estimate_errors, rules.scaling_study]
        if SIMULATED
        else []
    ),
    *([rules.contact_overlay] if EXTERNAL else []),
    *[getattr(rules, f"figures_{kind}") for kind in KINDS],
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
        floors=each_recording(f"{RESULTS}/ready/{{recording}}.json"),
        filled=[rules.quality.output.filled] if FILLS else [],
        sections=rules.sections.output.sections,
        touchdowns=rules.pairs.output.touchdowns,
        units=rules.pairs.output.units,
        prediction=rules.linear_maps.output.summary,
        distances=rules.distances.output.summary,
        verdict=rules.verdict.output.verdict,
        quality=rules.quality.output.checks,
        faults=rules.quality.output.faults,
        remarks=rules.quality.output.remarks,
        notes=[
            rules.linear_maps.output.notes,
            rules.distances.output.notes,
            rules.linear_maps.output.estimate_notes,
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
    resources:
        **needs(mb_a_mb=40, minutes=10),
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
