rule report:
    """Write one page with all results and their provenance."""
    input:
        figures=FIGURES,
        captions=local(expand(f"{CAPTIONS}/{{name}}.md", name=FIGURE_NAMES)),
        recordings=each_recording(f"{RESULTS}/recordings/{{recording}}.h5"),
        levelled=each_recording(f"{RESULTS}/level/{{recording}}.h5"),
        floors=each_recording(f"{RESULTS}/level/{{recording}}.json"),
        filled=f"{RESULTS}/tables/filled.csv" if FILLS else [],
        sections=f"{RESULTS}/sections.json",
        touchdowns=f"{RESULTS}/tables/touchdowns.csv",
        lags=f"{RESULTS}/tables/lags.csv",
        units=f"{RESULTS}/units.json",
        prediction=f"{RESULTS}/tables/prediction_summary.csv",
        distances=f"{RESULTS}/tables/distance_summary.csv" if DISTANCES else [],
        verdict=f"{RESULTS}/verdict.json",
        quality=f"{RESULTS}/quality.json",
        faults=f"{RESULTS}/tables/faults.csv",
        remarks=f"{RESULTS}/tables/remarks.csv",
        one_or_own=f"{RESULTS}/tables/one_or_own.csv",
        notes=[
            # Of Figs. 2.4 and 2.5, which only a study by the printed methods shows.
            *([f"{RESULTS}/maps/prediction_notes.json"] if STUDY["printed"] else []),
            *([f"{RESULTS}/maps/distances_notes.json"] if DISTANCES and STUDY["printed"] else []),
            f"{RESULTS}/maps/map_estimates_notes.json",
        ],
        truth=f"{RESULTS}/truth.json" if TRUTH_KNOWN else [],
        overlay=(
            [
                f"{RESULTS}/tables/contact_overlay_summary.csv",
                f"{RESULTS}/tables/contact_overlay.csv",
                f"{RESULTS}/tables/contact_overlay_thresholds.csv",
                f"{RESULTS}/tables/contact_overlay_notes.csv",
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
