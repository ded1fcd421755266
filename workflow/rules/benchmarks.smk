BENCHMARKS = "results/benchmarks"
# Each program of benchmarks/ and the tables that it writes: the one that it is told, others beside it.
BENCHMARK_TABLES = {
    "machine": ["machine.csv"],
    "order": ["order.csv", "theorem.csv"],
    "integrator": ["integrator.csv"],
    "work_precision": ["work_precision.csv", "ratios.csv"],
    "head_to_head": ["head_to_head.csv"],
    "calibration": ["calibration.csv", "calibration_table.csv", "calibration_trajectories.csv"],
    "plate": ["plate.csv", "plate_marginal.csv", "plate_scaling.csv"],
    "stress": ["stress.csv"],
    "first_solve": ["first_solve.csv"],
    "first_order": ["first_order.csv"],
    "contact_instants": ["contact_instants.csv"],
    "velocities": ["velocities.csv"],
    "density": ["density.csv"],
    "maps": ["maps.csv"],
    "map_error": ["map_error.csv", "map_error_spread.csv"],
    "gait": ["gait.csv"],
    "frame_change_models": [
        "frame_change_models.csv",
        "frame_change_learning.csv",
        "frame_change_kernels.csv",
        "frame_change_cost.csv",
        "frame_change_map.csv",
        "frame_change_points.csv",
    ],
    "steering_control": ["steering_control.csv", "steering_replanning.csv", "steering_turns.csv"],
    "steering_legs": ["steering_legs.csv"],
    "animals": ["animals.csv"],
    "filling": ["filling.csv"],
    "floor_faults": ["floor_faults.csv"],
    "reading": ["reading.csv", "reading_agreement.csv"],
    "damaged_files": ["damaged_files.csv"],
    "recording_faults": ["recording_faults.csv"],
    "pose": ["pose.csv", "pose_stances.csv", "pose_live.csv", "pose_time.csv"],
}
# They take one to two hours, and so are no part of `benchmarks`: `snakemake --cores 2 studies`.
SIMULATED_STUDIES = {
    "verdict_power": ["verdict_power.csv", "verdict_studies.csv"],
    "study_cost": ["study_cost.csv", "study_cost_stages.csv"],
}
# They run in real time for a quarter of an hour: `snakemake --cores 2 live`.
REAL_TIME_RUNS = {
    "live_loop": ["live_loop.csv"],
}
for program, tables in {**BENCHMARK_TABLES, **SIMULATED_STUDIES, **REAL_TIME_RUNS}.items():

    rule:
        name:
            f"benchmark_{program}"
        input:
            lambda wildcards, program=program: sources(program),
        output:
            table=f"{BENCHMARKS}/{tables[0]}",
            beside=[f"{BENCHMARKS}/{table}" for table in tables[1:]],
        log:
            f"{BENCHMARKS}/{program}.log",
        # Timings want a machine to themselves, and one for all: this one, whose cores they take.
        localrule: True
        threads: os.cpu_count()
        params:
            python=sys.executable,
            program=f"{PROGRAMS}/{program}.py",
            # Not of `input`: what depends on inputs is no reason for Snakemake to run a rule again.
            code=lambda wildcards, program=program: [code_digest(one) for one in sources(program)],
        shell:
            "OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1 "
            "{params.python} {params.program} --out {output.table} > {log} 2>&1"


for figure_name in [*CATALOGUE["benchmarks"], *CATALOGUE["studies"]]:
    job = drawn("benchmarks", BENCHMARKS, to=f"{BENCHMARKS}/figures", names=[figure_name])

    rule:
        name:
            f"figure_{figure_name}"
        input:
            **job["input"],
        output:
            job["output"],
        log:
            f"{BENCHMARKS}/figure_{figure_name}.log",
        resources:
            **needs(minutes=10),
        params:
            **job["params"],
        script:
            "../scripts/figures.py"


rule benchmark_page:
    """The figures with their captions on a page."""
    input:
        figures=expand(f"{BENCHMARKS}/figures/{{name}}.{FORMATS[0]}", name=CATALOGUE["benchmarks"]),
        captions=expand(f"{CAPTIONS}/{{name}}.md", name=CATALOGUE["benchmarks"]),
    output:
        f"{BENCHMARKS}/figures/README.md",
    log:
        f"{BENCHMARKS}/benchmark_page.log",
    resources:
        **needs(minutes=10),
    params:
        code=code("benchmark_page"),
    script:
        "../scripts/benchmark_page.py"


rule benchmarks:
    """All tables and figures of the benchmarks: `snakemake --cores 2 benchmarks`."""
    input:
        [f"{BENCHMARKS}/{table}" for tables in BENCHMARK_TABLES.values() for table in tables],
        expand(
            f"{BENCHMARKS}/figures/{{name}}.{{format}}",
            name=CATALOGUE["benchmarks"],
            format=FORMATS,
        ),
        rules.benchmark_page.output,


rule studies:
    """Hundreds of simulated studies: `snakemake --cores 2 studies`."""
    input:
        [f"{BENCHMARKS}/{table}" for tables in SIMULATED_STUDIES.values() for table in tables],
        expand(
            f"{BENCHMARKS}/figures/{{name}}.{{format}}", name=CATALOGUE["studies"], format=FORMATS
        ),


rule live:
    """The control loop over a real-time stream: `snakemake --cores 2 live`."""
    input:
        [f"{BENCHMARKS}/{table}" for tables in REAL_TIME_RUNS.values() for table in tables],
