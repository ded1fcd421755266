rule report:
    """Write one page with all results and their provenance."""
    input:
        figures=FIGURES,
        captions=expand(f"{CAPTIONS}/{{name}}.md", name=FIGURE_NAMES),
        recordings=each_recording(f"{RESULTS}/recordings/{{recording}}.h5"),
        levelled=each_recording(f"{RESULTS}/ready/{{recording}}.h5"),
        floors=each_recording(f"{RESULTS}/ready/{{recording}}.json"),
        filled=[rules.quality.output.filled] if FILLS else [],
        sections=rules.pairs.output.sections,
        touchdowns=rules.pairs.output.touchdowns,
        units=rules.pairs.output.units,
        prediction=rules.maps.output.prediction,
        distances=rules.maps.output.distance_summary if DISTANCES else [],
        verdict=rules.verdict.output.verdict,
        quality=rules.quality.output.checks,
        faults=rules.inspection.output.faults,
        remarks=rules.inspection.output.remarks,
        notes=[
            rules.maps.output.prediction_notes,
            *([rules.maps.output.distance_notes] if DISTANCES else []),
            rules.maps.output.estimate_notes,
        ],
        truth=rules.score.output.truth if TRUTH_KNOWN else [],
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
        **needs(mb_a_mb=10, minutes=10),
    params:
        study=STUDY,
        stage_times=stage_times(RESULTS),
        code=code("report"),
    script:
        "../scripts/report.py"
