# Written by `make rules` from src/hopdata/stages.py, which tells each stage once:
# edit that file. A rule calls the function of its name there. It states every file
# that is read and written, and every key of the configuration (STUDY) that is taken.
rule simulate:
    """Simulate a scene as motion capture would see it, and keep its truth."""
    output:
        simulated=f"{RESULTS}/simulated/{{recording}}.h5",
    log:
        f"{RESULTS}/logs/simulate_{{recording}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/simulate_{{recording}}.tsv"
    resources:
        **needs(minutes=20, mb_a_mb=0),
    params:
        stage="simulate",
        simulation=lambda wildcards: consistency.simulation_of(STUDY, wildcards.recording),
        motion_capture=STUDY["motion_capture"],
        seed=STUDY["seed"],
        number=lambda wildcards: stages.number_of(STUDY, wildcards.recording),
        code=stage_code("simulate"),
    script:
        "../scripts/stage.py"


rule import_recording:
    """Read the files of a recording, and refuse what cannot be motion capture."""
    input:
        files=source_files,
    output:
        imported=f"{RESULTS}/recordings/{{recording}}.h5",
    log:
        f"{RESULTS}/logs/import_recording_{{recording}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/import_recording_{{recording}}.tsv"
    resources:
        **needs(minutes=50, mb_a_mb=10),
    params:
        stage="import_recording",
        markers=STUDY["markers"],
        exclude=lambda wildcards: in_recordings("exclude")[wildcards.recording],
        options=STUDY["input"],
        quality=STUDY["quality"],
        stamps=source_stamps,
        code=stage_code("import_recording"),
    script:
        "../scripts/stage.py"


rule floor_compensation:
    """Subtract the floor on which the feet rest (Sec. 2.2.1), and fill short gaps."""
    input:
        imported=f"{RESULTS}/recordings/{{recording}}.h5",
    output:
        level=f"{RESULTS}/level/{{recording}}.h5",
        floor_model=f"{RESULTS}/level/{{recording}}.json",
    log:
        f"{RESULTS}/logs/floor_compensation_{{recording}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/floor_compensation_{{recording}}.tsv"
    resources:
        **needs(minutes=30, mb_a_mb=15),
    params:
        stage="floor_compensation",
        floor=STUDY["floor"],
        feet=STUDY["feet"],
        fills=consistency.fills(STUDY),
        longest_s=STUDY["filling"]["longest_s"],
        code=stage_code("floor_compensation"),
    script:
        "../scripts/stage.py"


rule foot_contacts:
    """Find the descents of the body, and when each foot touched (Sec. 2.2.3)."""
    input:
        level=each_recording(f"{RESULTS}/level/{{recording}}.h5"),
    output:
        contacts=each_recording(f"{RESULTS}/contacts/{{recording}}.csv"),
    log:
        f"{RESULTS}/logs/foot_contacts.log",
    benchmark:
        f"{RESULTS}/benchmarks/foot_contacts.tsv"
    resources:
        **needs(minutes=50, mb_a_mb=10),
    params:
        stage="foot_contacts",
        options=consistency.contact_options(STUDY),
        code=stage_code("foot_contacts"),
    script:
        "../scripts/stage.py"


rule poincare_sections:
    """Choose the two Poincare sections by the heights of body and feet (Sec. 2.2.2)."""
    input:
        level=each_recording(f"{RESULTS}/level/{{recording}}.h5"),
        contacts=each_recording(f"{RESULTS}/contacts/{{recording}}.csv"),
    output:
        sections=f"{RESULTS}/sections.json",
    log:
        f"{RESULTS}/logs/poincare_sections.log",
    benchmark:
        f"{RESULTS}/benchmarks/poincare_sections.tsv"
    priority: 2
    resources:
        **needs(minutes=30, mb_a_mb=10),
    params:
        stage="poincare_sections",
        options=all_but(STUDY["sections"], "grid_nodes"),
        states=STUDY["states"],
        code=stage_code("poincare_sections"),
    script:
        "../scripts/stage.py"


rule section_densities:
    """Tabulate the densities of heights that show where the sections lie (Fig. 2.2)."""
    input:
        level=each_recording(f"{RESULTS}/level/{{recording}}.h5"),
        contacts=each_recording(f"{RESULTS}/contacts/{{recording}}.csv"),
        sections=f"{RESULTS}/sections.json",
    output:
        section_densities=f"{RESULTS}/tables/section_densities.csv",
        section_frames=f"{RESULTS}/tables/section_frames.csv",
    log:
        f"{RESULTS}/logs/section_densities.log",
    benchmark:
        f"{RESULTS}/benchmarks/section_densities.tsv"
    resources:
        **needs(minutes=30, mb_a_mb=10),
    params:
        stage="section_densities",
        nodes=STUDY["sections"]["grid_nodes"],
        code=stage_code("section_densities"),
    script:
        "../scripts/stage.py"


rule mode_schedules:
    """Label each touchdown with the order of its contacts (Sec. 2.2.3, Fig. 2.3)."""
    input:
        level=each_recording(f"{RESULTS}/level/{{recording}}.h5"),
        contacts=each_recording(f"{RESULTS}/contacts/{{recording}}.csv"),
        sections=f"{RESULTS}/sections.json",
    output:
        schedules=f"{RESULTS}/schedules/{{method}}.csv",
    log:
        f"{RESULTS}/logs/mode_schedules_{{method}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/mode_schedules_{{method}}.tsv"
    priority: 2
    resources:
        **needs(minutes=30, mb_a_mb=10),
    params:
        stage="mode_schedules",
        options=all_but(STUDY["touchdowns"], "method"),
        largest_share=STUDY["filling"]["largest_share"],
        exclude=in_recordings("exclude"),
        code=stage_code("mode_schedules"),
    script:
        "../scripts/stage.py"


rule home_frame:
    """Put the states at both sections in their home frames (Sec. 2.2.4)."""
    input:
        level=each_recording(f"{RESULTS}/level/{{recording}}.h5"),
        sections=f"{RESULTS}/sections.json",
        schedules=f"{RESULTS}/schedules/{METHOD}.csv",
    output:
        pairs=f"{RESULTS}/pairs.h5",
        touchdowns=f"{RESULTS}/tables/touchdowns.csv",
        lags=f"{RESULTS}/tables/lags.csv",
        example_touchdown=f"{RESULTS}/tables/example_touchdown.csv",
    log:
        f"{RESULTS}/logs/home_frame.log",
    benchmark:
        f"{RESULTS}/benchmarks/home_frame.tsv"
    priority: 2
    resources:
        **needs(minutes=30, mb_a_mb=10),
    params:
        stage="home_frame",
        home_marker=STUDY["home"]["marker"],
        ambiguous=STUDY["touchdowns"]["ambiguous"],
        states=STUDY["states"],
        begins_s=in_recordings("begins_s"),
        code=stage_code("home_frame"),
    script:
        "../scripts/stage.py"


rule normalisation:
    """Choose units in which positions and velocities weigh the same (Sec. 2.2.4)."""
    input:
        pairs=f"{RESULTS}/pairs.h5",
    output:
        units=f"{RESULTS}/units.json",
    log:
        f"{RESULTS}/logs/normalisation.log",
    benchmark:
        f"{RESULTS}/benchmarks/normalisation.tsv"
    priority: 1
    resources:
        **needs(minutes=10, mb_a_mb=40),
    params:
        stage="normalisation",
        units=STUDY["units"],
        code=stage_code("normalisation"),
    script:
        "../scripts/stage.py"


rule prediction:
    """Predict the state after from the state before (Sec. 2.2.4, Fig. 2.4)."""
    input:
        pairs=f"{RESULTS}/pairs.h5",
        units=f"{RESULTS}/units.json",
    output:
        prediction_errors=f"{RESULTS}/tables/prediction_errors.csv",
        prediction_summary=f"{RESULTS}/tables/prediction_summary.csv",
        prediction_notes=f"{RESULTS}/maps/prediction_notes.json",
    log:
        f"{RESULTS}/logs/prediction.log",
    benchmark:
        f"{RESULTS}/benchmarks/prediction.tsv"
    priority: 1
    resources:
        **needs(minutes=30, mb_a_mb=60),
    params:
        stage="prediction",
        options=STUDY["prediction"],
        seed=STUDY["seed"],
        code=stage_code("prediction"),
    script:
        "../scripts/stage.py"


rule constraint_subspaces:
    """Compare the constraint subspaces of the contact orders (Sec. 2.3, Fig. 2.5)."""
    input:
        pairs=f"{RESULTS}/pairs.h5",
        units=f"{RESULTS}/units.json",
    output:
        distances=f"{RESULTS}/tables/distances.csv",
        distance_summary=f"{RESULTS}/tables/distance_summary.csv",
        distances_notes=f"{RESULTS}/maps/distances_notes.json",
    log:
        f"{RESULTS}/logs/constraint_subspaces.log",
    benchmark:
        f"{RESULTS}/benchmarks/constraint_subspaces.tsv"
    priority: 1
    resources:
        **needs(minutes=50, mb_a_mb=60),
    params:
        stage="constraint_subspaces",
        subspaces=STUDY["subspaces"],
        distances=all_but(STUDY["distances"], "enabled"),
        seed=STUDY["seed"],
        code=stage_code("constraint_subspaces"),
    script:
        "../scripts/stage.py"


rule landing_maps:
    """Fit the maps through the landing, rid of noise and curvature."""
    input:
        pairs=f"{RESULTS}/pairs.h5",
        units=f"{RESULTS}/units.json",
    output:
        map_estimates=f"{RESULTS}/tables/map_estimates.csv",
        maps=f"{RESULTS}/maps/map_estimates.json",
        map_notes=f"{RESULTS}/maps/map_estimates_notes.json",
        one_or_own=f"{RESULTS}/tables/one_or_own.csv",
    log:
        f"{RESULTS}/logs/landing_maps.log",
    benchmark:
        f"{RESULTS}/benchmarks/landing_maps.tsv"
    resources:
        **needs(minutes=30, mb_a_mb=60),
    params:
        stage="landing_maps",
        code=stage_code("landing_maps"),
    script:
        "../scripts/stage.py"


rule verdict:
    """Judge whether the map is C1: effect size, interval and bound."""
    input:
        pairs=f"{RESULTS}/pairs.h5",
        touchdowns=f"{RESULTS}/tables/touchdowns.csv",
    output:
        verdict=f"{RESULTS}/verdict.json",
        verdict_orders=f"{RESULTS}/tables/verdict_orders.csv",
    log:
        f"{RESULTS}/logs/verdict.log",
    benchmark:
        f"{RESULTS}/benchmarks/verdict.tsv"
    priority: 2
    resources:
        **needs(minutes=60, mb_a_mb=200),
    params:
        stage="verdict",
        options=STUDY["verdict"],
        blocks=in_recordings("block"),
        seed=STUDY["seed"],
        code=stage_code("verdict"),
    script:
        "../scripts/stage.py"


rule inspection:
    """Look for faults in the recordings, beside the search for contacts."""
    input:
        imported=each_recording(f"{RESULTS}/recordings/{{recording}}.h5"),
    output:
        markers=f"{RESULTS}/tables/markers.csv",
        gap_times=f"{RESULTS}/tables/gap_times.csv",
        faults=f"{RESULTS}/tables/faults.csv",
        remarks=f"{RESULTS}/tables/remarks.csv",
    log:
        f"{RESULTS}/logs/inspection.log",
    benchmark:
        f"{RESULTS}/benchmarks/inspection.tsv"
    resources:
        **needs(minutes=20, mb_a_mb=10),
    params:
        stage="inspection",
        methods=consistency.effect_methods(STUDY),
        code=stage_code("inspection"),
    script:
        "../scripts/stage.py"


rule quality:
    """Check whether the recordings and their landings can be trusted."""
    input:
        level=each_recording(f"{RESULTS}/level/{{recording}}.h5"),
        floor_model=each_recording(f"{RESULTS}/level/{{recording}}.json"),
        contacts=each_recording(f"{RESULTS}/contacts/{{recording}}.csv"),
        sections=f"{RESULTS}/sections.json",
        touchdowns=f"{RESULTS}/tables/touchdowns.csv",
        markers=f"{RESULTS}/tables/markers.csv",
        faults=f"{RESULTS}/tables/faults.csv",
    output:
        quality=f"{RESULTS}/quality.json",
        section_stability=f"{RESULTS}/tables/section_stability.csv",
        drift=f"{RESULTS}/tables/drift.csv",
        filled=f"{RESULTS}/tables/filled.csv",
    log:
        f"{RESULTS}/logs/quality.log",
    benchmark:
        f"{RESULTS}/benchmarks/quality.tsv"
    resources:
        **needs(minutes=20, mb_a_mb=10),
    params:
        stage="quality",
        section_options=all_but(STUDY["sections"], "grid_nodes"),
        expected_noise_m=consistency.expected_noise_m(STUDY),
        code=stage_code("quality"),
    script:
        "../scripts/stage.py"
