BENCHMARKS = "results/benchmarks"
# The tables that each program of benchmarks/ writes: its `--out` first, then those beside it. The
# benchmarks of a product stand in a folder of their own and have its name before theirs.
BENCHMARK_TABLES = {
    "machine": ["machine.csv"],
    "order": ["order.csv", "dense.csv"],
    "integrator": ["integrator.csv"],
    "work_precision": ["work_precision.csv", "ratios.csv", "head_to_head.csv", "batches.csv"],
    "side_by_side": [
        "side_by_side.csv",
        "side_by_side_ratios.csv",
        "side_by_side_starts.csv",
        "side_by_side_lines.csv",
    ],
    "calibration": ["calibration.csv", "calibration_table.csv"],
    "plate": ["plate.csv", "plate_scaling.csv"],
    "large": ["large.csv"],
    "stress": ["stress.csv"],
    "proofs": ["proofs.csv"],
    "gradients": ["gradients.csv"],
    "first_solve": ["first_solve.csv"],
    "first_order": ["first_order.csv"],
    "derivative_error": ["derivative_error.csv"],
    "known_instants": ["known_instants.csv"],
    "sliding": ["sliding.csv"],
    "contact_instants": ["contact_instants.csv"],
    "check_forecast": ["check_forecast.csv"],
    "foot_strikes": ["foot_strikes.csv"],
    "jumps": ["jumps.csv"],
    "springy_soles": ["springy_soles.csv"],
    "curved_swings": ["curved_swings.csv"],
    "velocities": ["velocities.csv", "map_error.csv", "map_error_spread.csv"],
    "maps": ["maps.csv"],
    "verdict_power": [
        "verdict_power.csv",
        "verdict_promise.csv",
        "verdict_studies.csv",
        "group_power.csv",
    ],
    "verdict_campaign": [
        "verdict_campaign.csv",
        "verdict_campaign_studies.csv",
        "verdict_campaign_detectable.csv",
    ],
    "verdict_curvature": ["verdict_curvature.csv", "verdict_curvature_studies.csv"],
    "verdict_growth": [
        "verdict_growth.csv",
        "verdict_growth_studies.csv",
        "verdict_shapes.csv",
        "verdict_shapes_studies.csv",
        "verdict_unseen.csv",
        "verdict_unseen_studies.csv",
    ],
    "verdict_jumps": ["verdict_jumps.csv", "verdict_jumps_studies.csv"],
    "verdict_groups": [
        "verdict_groups.csv",
        "verdict_groups_studies.csv",
        "verdict_groups_levels.csv",
    ],
    "study_cost": ["study_cost.csv", "study_cost_stages.csv"],
    "animals": ["animals.csv"],
    "recording_faults": [
        "recording_faults.csv",
        "floor_faults.csv",
        "filling.csv",
        "moved_floors.csv",
    ],
    "guesses": ["guesses.csv"],
    "reading": ["reading.csv", "reading_agreement.csv", "damaged_files.csv"],
}
# Smaller than the programs' defaults, so that all of them finish within an hour on two cores.
BENCHMARK_ARGUMENTS = {
    "animals": "--hops 60 --rates 100 500",
    "check_forecast": "--only sound '33 Hz' 'no flight' 'a wrong section'",
    "contact_instants": "--seeds 2 --landings 1000 --peer-landings 100",
    "first_solve": "--repeats 1",
    "foot_strikes": "--seeds 3",
    "guesses": "--seeds 1",
    "integrator": "--repeats 7",
    "jumps": "--seeds 1 --no-check",
    "known_instants": "--seeds 2 3 4 5 6",
    "large": "--largest 2000",
    "maps": "--bootstraps 300 --pairs 5000",
    "order": "--runs 32",
    "plate": "--starts 50",
    "proofs": "--members 3 --peers",
    "reading": "--files 2100 --rounds 3",
    "recording_faults": "--recordings 6 --floor-seeds 3 --filled-hops 300",
    "side_by_side": "--turns 3",
    "sliding": "--members 3",
    "springy_soles": "--seeds 2",
    "stress": "--hops 20000 --systems 100",
    "study_cost": "--base 0.07",
    "velocities": "--draws 10",
    "verdict_campaign": "--studies 1",
    "verdict_curvature": "--studies 1",
    "verdict_growth": "--studies 1",
    "verdict_groups": "--subjects 16",
    "verdict_jumps": "--studies 2",
    "verdict_power": "--studies 1",
    "work_precision": "--turns 7 --race-turns 30 --systems 4000",
}
# Programs whose tables hold errors or processor time. They run in parallel; all others run alone.
UNTIMED = {
    "animals",
    "check_forecast",
    "contact_instants",
    "curved_swings",
    "foot_strikes",
    "guesses",
    "jumps",
    "maps",
    "order",
    "recording_faults",
    "sliding",
    "springy_soles",
    "velocities",
}
# Each figure, and the tables that it is drawn from: by `benchmark_figures.py`, or by the
# `<product>_figures.py` of a product.
BENCHMARK_FIGURES = {
    "work_precision": ["work_precision.csv", "ratios.csv"],
    "side_by_side": ["side_by_side_ratios.csv"],
    "side_by_side_panels": ["side_by_side.csv", "side_by_side_ratios.csv"],
    "map_error": ["map_error.csv"],
    "verdict_power": ["verdict_power.csv"],
    "foot_strikes": ["foot_strikes.csv"],
    "study_cost": ["study_cost.csv"],
}
# Products add theirs to these tables; where they are deleted, their files are gone as well.
for tables_of_product in sorted(HERE.parents[1].glob("benchmarks/*/benchmarks.smk")):

    include: tables_of_product


for program, tables in BENCHMARK_TABLES.items():
    benchmark_name = os.path.basename(program)

    rule:
        name:
            f"benchmark_{benchmark_name}"
        input:
            lambda wildcards, program=program: sources(program),
        output:
            table=f"{BENCHMARKS}/{tables[0]}",
            beside=[f"{BENCHMARKS}/{table}" for table in tables[1:]],
        log:
            f"{BENCHMARKS}/{benchmark_name}.log",
        # Timings need the same machine, and all of it: run locally and occupy every core.
        localrule: True
        threads: 1 if program in UNTIMED else os.cpu_count()
        params:
            python=sys.executable,
            program=f"{PROGRAMS}/{program}.py",
            arguments=BENCHMARK_ARGUMENTS.get(program, ""),
            # Does not use `input`: Snakemake reruns no rule for parameters that depend on inputs.
            code=lambda wildcards, program=program: [code_digest(one) for one in sources(program)],
        shell:
            "OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1 "
            "{params.python} {params.program} --out {output.table} {params.arguments} > {log} 2>&1"


for figure, tables in BENCHMARK_FIGURES.items():
    figure_name = os.path.basename(figure)

    rule:
        name:
            f"figure_{figure_name}"
        input:
            expand(f"{BENCHMARKS}/{{table}}", table=tables),
        output:
            expand(f"{BENCHMARKS}/figures/{figure_name}.{{format}}", format=FORMATS),
        log:
            f"{BENCHMARKS}/figure_{figure_name}.log",
        resources:
            **needs(minutes=10),
        params:
            python=sys.executable,
            program=f"{drawer_of(figure)}",
            figure=figure_name,
            base=lambda wildcards, output: os.path.splitext(output[0])[0],
            dpi=STUDY["figures"]["dpi"],
            formats=FORMATS,
            code=lambda wildcards, drawer=drawer_of(figure): code_digest(drawer),
        shell:
            "{params.python} {params.program} {params.figure} {input} --out {params.base} "
            "--dpi {params.dpi} --formats {params.formats} > {log} 2>&1"


rule benchmark_page:
    """Show every table and figure of the last run on one page, with the machine it ran on."""
    input:
        tables=[f"{BENCHMARKS}/{table}" for tables in BENCHMARK_TABLES.values() for table in tables],
        figures=expand(
            f"{BENCHMARKS}/figures/{{name}}.{FORMATS[0]}",
            name=map(os.path.basename, BENCHMARK_FIGURES),
        ),
        captions=captions_of(BENCHMARK_FIGURES),
    output:
        f"{BENCHMARKS}/README.md",
    log:
        f"{BENCHMARKS}/benchmark_page.log",
    resources:
        **needs(minutes=10),
    params:
        programs={
            name: {
                "file": f"{PROGRAMS}/{name}.py",
                "tables": tables,
                "arguments": BENCHMARK_ARGUMENTS.get(name, "").split(),
            }
            for name, tables in BENCHMARK_TABLES.items()
        },
        drawn_from={os.path.basename(name): tables for name, tables in BENCHMARK_FIGURES.items()},
        code=code("benchmark_page"),
    script:
        "../scripts/benchmark_page.py"


rule benchmarks:
    """Make all tables and figures of the benchmarks: `snakemake --cores 2 benchmarks`."""
    input:
        rules.benchmark_page.output,
        expand(
            f"{BENCHMARKS}/figures/{{name}}.{{format}}",
            name=map(os.path.basename, BENCHMARK_FIGURES),
            format=FORMATS,
        ),
