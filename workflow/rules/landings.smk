rule level:
    """Fit the floor to the feet at rest and take it off."""
    input:
        recording=f"{RESULTS}/recordings/{{recording}}.h5",
    output:
        recording=f"{RESULTS}/level/{{recording}}.h5",
        floor=f"{RESULTS}/level/{{recording}}.json",
    log:
        f"{RESULTS}/logs/level_{{recording}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/level_{{recording}}.tsv"
    params:
        options=STUDY["floor"],
        code=code("level"),
    script:
        "../scripts/level.py"


if FILLS:

    rule fill:
        """Fill short gaps of the body markers, and mark what was filled."""
        input:
            recording=rules.level.output.recording,
        output:
            recording=READY,
        log:
            f"{RESULTS}/logs/fill_{{recording}}.log",
        benchmark:
            f"{RESULTS}/benchmarks/fill_{{recording}}.tsv"
        params:
            longest_s=STUDY["filling"]["longest_s"],
            method=STUDY["filling"]["method"],
            code=code("fill"),
        script:
            "../scripts/fill.py"

    rule filled:
        """Gaps of every marker, and what was filled of them."""
        input:
            recordings=each_recording(READY),
        output:
            filled=f"{RESULTS}/tables/filled.csv",
        log:
            f"{RESULTS}/logs/filled.log",
        benchmark:
            f"{RESULTS}/benchmarks/filled.tsv"
        params:
            code=code("filled"),
        script:
            "../scripts/filled.py"


rule sections:
    """Choose the Poincare sections before and after touchdown from all recordings."""
    input:
        recordings=each_recording(READY),
    output:
        sections=f"{RESULTS}/landings/sections.json",
        densities=f"{RESULTS}/tables/section_densities.csv",
        frames=f"{RESULTS}/tables/section_frames.csv",
    log:
        f"{RESULTS}/logs/sections.log",
    benchmark:
        f"{RESULTS}/benchmarks/sections.tsv"
    params:
        options=STUDY["sections"],
        code=code("sections"),
    script:
        "../scripts/sections.py"


rule touchdowns:
    """Contact instants, mode schedules and exclusions of one recording."""
    input:
        recording=READY,
        sections=rules.sections.output.sections,
    output:
        touchdowns=[f"{RESULTS}/landings/{METHOD}/{{recording}}.csv"],
    log:
        f"{RESULTS}/logs/touchdowns_{{recording}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/touchdowns_{{recording}}.tsv"
    priority: 1  # more waits for it than for a figure
    params:
        methods=[METHOD],
        options=STUDY["touchdowns"],
        largest_share=STUDY["filling"]["largest_share"],
        code=code("touchdowns"),
    script:
        "../scripts/touchdowns.py"


if COMPARED_METHODS:

    use rule touchdowns as compared_touchdowns with:
        output:
            touchdowns=[
                f"{RESULTS}/landings/{method}/{{recording}}.csv" for method in COMPARED_METHODS
            ],
        log:
            f"{RESULTS}/logs/compared_touchdowns_{{recording}}.log",
        benchmark:
            f"{RESULTS}/benchmarks/compared_touchdowns_{{recording}}.tsv"
        priority: 0
        params:
            methods=COMPARED_METHODS,


rule pairs:
    """States at the two sections in each touchdown's home frame, and the table of touchdowns."""
    input:
        recordings=each_recording(READY),
        touchdowns=each_recording(f"{RESULTS}/landings/{METHOD}/{{recording}}.csv"),
        sections=rules.sections.output.sections,
    output:
        pairs=f"{RESULTS}/landings/pairs.h5",
        touchdowns=f"{RESULTS}/tables/touchdowns.csv",
        example=f"{RESULTS}/tables/example_touchdown.csv",
    log:
        f"{RESULTS}/logs/pairs.log",
    benchmark:
        f"{RESULTS}/benchmarks/pairs.tsv"
    priority: 1  # more waits for it than for a figure
    params:
        home=STUDY["home"],
        states=STUDY["states"],
        ambiguous=STUDY["touchdowns"]["ambiguous"],
        code=code("pairs"),
    script:
        "../scripts/pairs.py"


rule quality:
    """Whether the recordings and their landings are to be trusted."""
    input:
        recordings=each_recording(f"{RESULTS}/recordings/{{recording}}.h5"),
        levelled=each_recording(READY),
        sections=rules.sections.output.sections,
        touchdowns=rules.pairs.output.touchdowns,
    output:
        checks=f"{RESULTS}/quality.json",
        markers=f"{RESULTS}/tables/markers.csv",
        gaps=f"{RESULTS}/tables/gap_times.csv",
        faults=f"{RESULTS}/tables/faults.csv",
        remarks=f"{RESULTS}/tables/remarks.csv",
        stability=f"{RESULTS}/tables/section_stability.csv",
        drift=f"{RESULTS}/tables/drift.csv",
        landings=f"{RESULTS}/tables/worst_landings.csv",
        samples=f"{RESULTS}/tables/worst_landing_samples.csv",
    log:
        f"{RESULTS}/logs/quality.log",
    benchmark:
        f"{RESULTS}/benchmarks/quality.tsv"
    params:
        sections=STUDY["sections"],
        number=STUDY["report"]["worst_landings"],
        noise_m=(
            STUDY["motion_capture"]["noise_m"]
            if SIMULATED
            else STUDY["report"]["expected_noise_m"]
        ),
        code=code("quality"),
    script:
        "../scripts/quality.py"
