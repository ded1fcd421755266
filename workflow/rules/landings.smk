rule pairs:
    """Find Poincare sections, touchdowns by each method, and states at both sections in home frames."""
    input:
        recordings=each_recording(READY),
        landings=each_recording(CONTACTS),
    output:
        sections=f"{RESULTS}/landings/sections.json",
        densities=f"{RESULTS}/tables/section_densities.csv",
        frames=f"{RESULTS}/tables/section_frames.csv",
        labelled=[path for method in LABELLED_BY for path in touchdowns_by(method)],
        pairs=f"{RESULTS}/landings/pairs.h5",
        touchdowns=f"{RESULTS}/tables/touchdowns.csv",
        example=f"{RESULTS}/tables/example_touchdown.csv",
        units=f"{RESULTS}/tables/units.json",
    log:
        f"{RESULTS}/logs/pairs.log",
    benchmark:
        f"{RESULTS}/benchmarks/pairs.tsv"
    priority: 1  # more jobs wait for it than for a figure
    resources:
        **needs(mb_a_mb=10, minutes=30),
    params:
        sections={key: value for key, value in STUDY["sections"].items() if key != "grid_nodes"},
        nodes=STUDY["sections"]["grid_nodes"],
        methods=LABELLED_BY,
        touchdowns={**STUDY["touchdowns"], "largest_share": STUDY["filling"]["largest_share"]},
        exclude=[entry["exclude"] for entry in STUDY["recordings"]],
        home={"home_marker": STUDY["home"]["marker"]},
        states=STUDY["states"],
        units=STUDY["units"],
        code=code("pairs"),
    script:
        "../scripts/pairs.py"


rule quality:
    """Check whether the recordings and their landings can be trusted."""
    input:
        levelled=each_recording(READY),
        floors=each_recording(f"{RESULTS}/ready/{{recording}}.json"),
        landings=each_recording(CONTACTS),
        sections=rules.pairs.output.sections,
        touchdowns=rules.pairs.output.touchdowns,
        markers=rules.inspection.output.markers,
        faults=rules.inspection.output.faults,
    output:
        **({"filled": f"{RESULTS}/tables/filled.csv"} if FILLS else {}),
        checks=f"{RESULTS}/quality.json",
        stability=f"{RESULTS}/tables/section_stability.csv",
        drift=f"{RESULTS}/tables/drift.csv",
    log:
        f"{RESULTS}/logs/quality.log",
    benchmark:
        f"{RESULTS}/benchmarks/quality.tsv"
    resources:
        **needs(mb_a_mb=10, minutes=20),
    params:
        sections=STUDY["sections"],
        noise_m=consistency.expected_noise_m(STUDY),
        code=code("quality"),
    script:
        "../scripts/quality.py"
