# Chapter III: `snakemake --cores 2 steering`. Without recordings in which the boom moves, the robot is
# simulated; experiments are made with the simulated robot alone.
STEERED = STUDY["steering"]["recordings"]
STEERING_TABLES = f"{STEERING}/tables"
EXPERIMENTS = ["origin", "turn", "origin_board", "turn_board"]
FILMED = "origin"
MODEL_FIGURES, RUN_FIGURES = map(list, (CATALOGUE["steering_model"], CATALOGUE["steering_runs"]))


wildcard_constraints:
    experiment="|".join(EXPERIMENTS),


rule steering_excite:
    """The simulated robot executes an excitation, seen by motion capture; with its truth."""
    output:
        recording=f"{STEERING}/recordings/excitation.h5",
        stances=f"{STEERING_TABLES}/true_stances.csv",
        motion=f"{STEERING_TABLES}/true_motion.csv",
    log:
        f"{STEERING}/logs/steering_excite.log",
    benchmark:
        f"{STEERING}/benchmarks/steering_excite.tsv"
    resources:
        **needs(minutes=20),
    params:
        steering={key: STUDY["steering"][key] for key in ("excitation", "robot")},
        motion_capture=STUDY["motion_capture"],
        seed=STUDY["seed"],
        code=code("steering_excite"),
    script:
        "../scripts/steering_excite.py"


rule steering_observe:
    """Pose, boom angle and stances, and the frame change of each hop."""
    input:
        recordings=(
            expand(f"{RESULTS}/recordings/{{recording}}.h5", recording=STEERED)
            or [rules.steering_excite.output.recording]
        ),
    output:
        changes=f"{STEERING_TABLES}/frame_changes.csv",
        stances=f"{STEERING_TABLES}/stances.csv",
        motion=f"{STEERING_TABLES}/motion.csv",
        counts=f"{STEERING_TABLES}/observed.json",
        geometry=f"{STEERING}/geometry.json",
    log:
        f"{STEERING}/logs/steering_observe.log",
    benchmark:
        f"{STEERING}/benchmarks/steering_observe.tsv"
    resources:
        **needs(mb_a_mb=60, minutes=20),
    params:
        swing_limit_rad=STUDY["steering"]["robot"]["swing_limit_rad"],
        code=code("steering_observe"),
    script:
        "../scripts/steering_observe.py"


rule steering_true_map:
    """The frame changes of the simulated robot that nothing disturbs."""
    output:
        table=f"{STEERING_TABLES}/true_map.csv",
    log:
        f"{STEERING}/logs/steering_true_map.log",
    benchmark:
        f"{STEERING}/benchmarks/steering_true_map.tsv"
    resources:
        **needs(minutes=20),
    params:
        robot=STUDY["steering"]["robot"],
        motion_capture=STUDY["motion_capture"],
        code=code("steering_true_map"),
    script:
        "../scripts/steering_true_map.py"


rule steering_model:
    """Gaussian processes of the frame change, learned from some of the hops."""
    input:
        changes=rules.steering_observe.output.changes,
    output:
        models=[
            f"{STEERING}/models/set{k + 1}.npz" for k in range(STUDY["steering"]["model"]["sets"])
        ],
        scores=f"{STEERING_TABLES}/model_scores.csv",
        map=f"{STEERING_TABLES}/model_map.csv",
        training=f"{STEERING_TABLES}/training_hops.csv",
    log:
        f"{STEERING}/logs/steering_model.log",
    benchmark:
        f"{STEERING}/benchmarks/steering_model.tsv"
    resources:
        **needs(minutes=20),
    params:
        model=STUDY["steering"]["model"],
        swing_limit_rad=STUDY["steering"]["robot"]["swing_limit_rad"],
        seed=STUDY["seed"],
        code=code("steering_model"),
    script:
        "../scripts/steering_model.py"


rule steering_experiment:
    """One experiment: all controllers from all starts."""
    input:
        models=rules.steering_model.output.models,
        true_map=rules.steering_true_map.output.table,
        geometry=rules.steering_observe.output.geometry,
    output:
        runs=f"{STEERING}/experiments/{{experiment}}/runs.csv",
        stances=f"{STEERING}/experiments/{{experiment}}/stances.csv",
        example=f"{STEERING}/experiments/{{experiment}}/example.csv",
        film=f"{STEERING}/experiments/{{experiment}}/film.csv",
    log:
        f"{STEERING}/logs/steering_experiment_{{experiment}}.log",
    benchmark:
        f"{STEERING}/benchmarks/steering_experiment_{{experiment}}.tsv"
    resources:
        **needs(minutes=60),
    params:
        steering={key: STUDY["steering"][key] for key in ("robot", "control", "experiments")},
        motion_capture=STUDY["motion_capture"],
        seed=STUDY["seed"],
        code=code("steering_experiment"),
    script:
        "../scripts/steering_experiment.py"


rule steering_outcomes:
    """Success rates and hops to the goal, with intervals; all trajectories."""
    input:
        runs=expand(rules.steering_experiment.output.runs, experiment=EXPERIMENTS),
        stances=expand(rules.steering_experiment.output.stances, experiment=EXPERIMENTS),
        examples=expand(rules.steering_experiment.output.example, experiment=EXPERIMENTS),
    output:
        outcomes=f"{STEERING_TABLES}/outcomes.csv",
        runs=f"{STEERING_TABLES}/runs.csv",
        trajectories=f"{STEERING_TABLES}/trajectories.csv",
        examples=f"{STEERING_TABLES}/examples.csv",
    log:
        f"{STEERING}/logs/steering_outcomes.log",
    benchmark:
        f"{STEERING}/benchmarks/steering_outcomes.tsv"
    resources:
        **needs(minutes=10),
    params:
        seed=STUDY["seed"],
        confidence=STUDY["steering"]["experiments"]["confidence"],
        code=code("steering_outcomes"),
    script:
        "../scripts/steering_outcomes.py"


rule steering_score:
    """Pose, boom angle, stances and model against the truth of the simulation."""
    input:
        motion=rules.steering_observe.output.motion,
        stances=rules.steering_observe.output.stances,
        true_motion=rules.steering_excite.output.motion,
        true_stances=rules.steering_excite.output.stances,
        model=rules.steering_model.output.models[0],
        true_map=rules.steering_true_map.output.table,
    output:
        truth=f"{STEERING}/truth.json",
    log:
        f"{STEERING}/logs/steering_score.log",
    benchmark:
        f"{STEERING}/benchmarks/steering_score.tsv"
    resources:
        **needs(minutes=10),
    params:
        code=code("steering_score"),
    script:
        "../scripts/steering_score.py"


rule steering_learning:
    """How many hops it takes to learn the frame change, and whether the kernel matters."""
    input:
        changes=rules.steering_observe.output.changes,
    output:
        curve=f"{STEERING_TABLES}/learning_curve.csv",
        kernels=f"{STEERING_TABLES}/kernels.csv",
    log:
        f"{STEERING}/logs/steering_learning.log",
    benchmark:
        f"{STEERING}/benchmarks/steering_learning.tsv"
    resources:
        **needs(minutes=20),
    params:
        model=STUDY["steering"]["model"],
        seed=STUDY["seed"],
        code=code("steering_learning"),
    script:
        "../scripts/steering_learning.py"


for kind in ("steering_model", "steering_runs"):
    job = drawn(kind, STEERING, to=f"{STEERING}/figures")

    rule:
        name:
            f"figures_{kind}"
        input:
            **job["input"],
        output:
            job["output"],
        log:
            f"{STEERING}/logs/figures_{kind}.log",
        benchmark:
            f"{STEERING}/benchmarks/figures_{kind}.tsv"
        resources:
            **needs(minutes=10),
        params:
            **job["params"],
        script:
            "../scripts/figures.py"


rule steering_film:
    """A typical run to the origin as an animated GIF."""
    input:
        film=f"{STEERING}/experiments/{FILMED}/film.csv",
        example=f"{STEERING}/experiments/{FILMED}/example.csv",
    output:
        film=f"{STEERING}/figures/steering_film.gif",
    log:
        f"{STEERING}/logs/steering_film.log",
    benchmark:
        f"{STEERING}/benchmarks/steering_film.tsv"
    resources:
        **needs(minutes=10),
    params:
        code=code("steering_film"),
    script:
        "../scripts/steering_film.py"


# What the page shows; of a recorded robot neither experiments nor truth.
STEERING_PAGE = {
    "figures": [
        *([] if STEERED else [*rules.figures_steering_runs.output, *rules.steering_film.output]),
        *rules.figures_steering_model.output,
    ],
    "captions": expand(
        f"{CAPTIONS}/{{name}}.md",
        name=[
            *MODEL_FIGURES,
            *([] if STEERED else [*RUN_FIGURES, "steering_film"]),
        ],
    ),
    "recordings": list(rules.steering_observe.input.recordings),
    "counts": rules.steering_observe.output.counts,
    "scores": rules.steering_model.output.scores,
    **(
        {}
        if STEERED
        else {
            "outcomes": rules.steering_outcomes.output.outcomes,
            "truth": rules.steering_score.output.truth,
        }
    ),
}


rule steering_report:
    """A page with everything on the steering, and where it comes from."""
    input:
        **STEERING_PAGE,
    output:
        report=f"{STEERING}/report.html",
        provenance=f"{STEERING}/provenance.json",
    log:
        f"{STEERING}/logs/steering_report.log",
    resources:
        **needs(mb_a_mb=40, minutes=10),
    params:
        study=STUDY,
        stage_times=stage_times(STEERING),
        code=code("steering_report"),
    script:
        "../scripts/steering_report.py"


rule steering:
    """Everything of chapter III: `snakemake --cores 2 steering`."""
    input:
        rules.steering_report.output,
