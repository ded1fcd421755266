rule simulate:
    """Simulate a scene as motion capture would see it, and keep its truth."""
    output:
        recording=f"{RESULTS}/simulated/{{recording}}.h5",
    log:
        f"{RESULTS}/logs/simulate_{{recording}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/simulate_{{recording}}.tsv"
    resources:
        **needs(minutes=20),
    params:
        simulation=lambda wildcards: SIMULATIONS[wildcards.recording],
        motion_capture=STUDY["motion_capture"],
        seed=STUDY["seed"],
        number=lambda wildcards: RECORDINGS.index(wildcards.recording),
        code=code("simulate"),
    script:
        "../scripts/simulate.py"


rule recording:
    """Import a file in metres, z up; level it, fill short gaps, and find descents and contacts."""
    input:
        source=lambda wildcards: (SOURCES[wildcards.recording] or rules.simulate.output.recording),
    output:
        recording=f"{RESULTS}/recordings/{{recording}}.h5",
        ready=READY,
        floor=f"{RESULTS}/ready/{{recording}}.json",
        landings=CONTACTS,
    log:
        f"{RESULTS}/logs/recording_{{recording}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/recording_{{recording}}.tsv"
    resources:
        **needs(mb_a_mb=10, minutes=50),
    params:
        markers=STUDY["markers"],
        feet=STUDY["feet"],
        options=STUDY["input"],
        exclude=lambda wildcards: EXCLUDED[wildcards.recording],
        quality=STUDY["quality"],
        floor=STUDY["floor"],
        fills=FILLS,
        longest_s=STUDY["filling"]["longest_s"],
        contacts=consistency.contact_options(STUDY),
        stamps=lambda wildcards: stamps(SOURCES[wildcards.recording]),
        code=code("recording"),
    script:
        "../scripts/recording.py"


rule inspection:
    """Look for faults in the recordings; runs in parallel with the search for sections."""
    input:
        recordings=each_recording(rules.recording.output.recording),
    output:
        markers=f"{RESULTS}/tables/markers.csv",
        gaps=f"{RESULTS}/tables/gap_times.csv",
        faults=f"{RESULTS}/tables/faults.csv",
        remarks=f"{RESULTS}/tables/remarks.csv",
    log:
        f"{RESULTS}/logs/inspection.log",
    benchmark:
        f"{RESULTS}/benchmarks/inspection.tsv"
    resources:
        **needs(mb_a_mb=10, minutes=20),
    params:
        code=code("inspection"),
    script:
        "../scripts/inspection.py"
