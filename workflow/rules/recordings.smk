rule simulate:
    """A scene as motion capture would see it, with its truth beside it."""
    output:
        recording=f"{RESULTS}/simulated/{{recording}}.h5",
    log:
        f"{RESULTS}/logs/simulate_{{recording}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/simulate_{{recording}}.tsv"
    params:
        simulation=lambda wildcards: SIMULATIONS[wildcards.recording],
        motion_capture=STUDY["motion_capture"],
        seed=STUDY["seed"],
        number=lambda wildcards: RECORDINGS.index(wildcards.recording),
        code=code("simulate"),
    script:
        "../scripts/simulate.py"


rule import_recording:
    """Any supported file, in the one form that the analysis reads: metres, z up, known roles."""
    input:
        source=lambda wildcards: (SOURCES[wildcards.recording] or rules.simulate.output.recording),
    output:
        recording=f"{RESULTS}/recordings/{{recording}}.h5",
    log:
        f"{RESULTS}/logs/import_{{recording}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/import_{{recording}}.tsv"
    params:
        markers=STUDY["markers"],
        options=STUDY["input"],
        quality=STUDY["quality"],
        code=code("import_recording"),
    script:
        "../scripts/import_recording.py"
