# Chapter III: `snakemake --cores 2 steering`. The robot is simulated if no recording with a moving
# boom is given. Only the simulated robot makes experiments.
include: "common.smk"


wildcard_constraints:
    seed="[0-9]+(_[a-z]+)?",
    manoeuvre="|".join(MANOEUVRES),


rule steering_learn:
    """Observe the frame changes of an excitation, simulated if none is recorded, and learn them."""
    input:
        expand(f"{RESULTS}/recordings/{{recording}}.h5", recording=STEERED),
    output:
        **(
            {}
            if STEERED
            else {
                "recording": f"{OF_SEED}/excitation.h5",
                "true_stances": f"{OF_SEED}/true_stances.csv",
                "true_motion": f"{OF_SEED}/true_motion.csv",
            }
        ),
        model=f"{OF_SEED}/model.npz",
        geometry=f"{OF_SEED}/geometry.json",
        changes=f"{OF_SEED}/frame_changes.csv",
        stances=f"{OF_SEED}/stances.csv",
        motion=f"{OF_SEED}/motion.csv",
        counts=f"{OF_SEED}/observed.json",
        scores=f"{OF_SEED}/model_scores.csv",
    log:
        f"{STEERING}/logs/steering_learn_{{seed}}.log",
    benchmark:
        f"{STEERING}/benchmarks/steering_learn_{{seed}}.tsv"
    resources:
        **needs(mb_a_mb=60, minutes=20),
    params:
        steering={key: STUDY["steering"][key] for key in ("excitation", "robot", "model")},
        observation=lambda wildcards: (
            wildcards.seed.partition("_")[2] or STUDY["steering"]["observations"][0]
        ),
        motion_capture=STUDY["motion_capture"],
        seed=STUDY["seed"],
        code=steering_code("steering_learn"),
    script:
        "scripts/steering_learn.py"


rule steering_true_map:
    """Compute the frame changes of the undisturbed simulated robot."""
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
        code=steering_code("steering_true_map"),
    script:
        "scripts/steering_true_map.py"


rule steering_experiments:
    """Run one manoeuvre on free ground and with a board: all controllers from all starts."""
    input:
        model=rules.steering_learn.output.model,
        true_map=rules.steering_true_map.output.table,
        geometry=rules.steering_learn.output.geometry,
    output:
        runs=f"{OF_SEED}/{{manoeuvre}}/runs.csv",
        stances=f"{OF_SEED}/{{manoeuvre}}/stances.csv",
        example=f"{OF_SEED}/{{manoeuvre}}/example.csv",
        film=f"{OF_SEED}/{{manoeuvre}}/film.csv",
    log:
        f"{STEERING}/logs/steering_experiments_{{seed}}_{{manoeuvre}}.log",
    benchmark:
        f"{STEERING}/benchmarks/steering_experiments_{{seed}}_{{manoeuvre}}.tsv"
    # The longest jobs first: what is short fits beside them, and a core is idle for less at the end.
    priority: 1
    resources:
        **needs(minutes=60),
    params:
        steering={key: STUDY["steering"][key] for key in ("robot", "control", "experiments")},
        motion_capture=STUDY["motion_capture"],
        seed=STUDY["seed"],
        code=steering_code("steering_experiments"),
    script:
        "scripts/steering_experiments.py"


rule steering_horizons:
    """Measure how the horizon alone affects the printed controller."""
    input:
        model=of_first(rules.steering_learn.output.model),
        true_map=rules.steering_true_map.output.table,
        geometry=of_first(rules.steering_learn.output.geometry),
    output:
        table=f"{STEERING_TABLES}/horizons.csv",
    log:
        f"{STEERING}/logs/steering_horizons.log",
    benchmark:
        f"{STEERING}/benchmarks/steering_horizons.tsv"
    resources:
        **needs(minutes=60),
    params:
        steering={key: STUDY["steering"][key] for key in ("robot", "control", "experiments")},
        motion_capture=STUDY["motion_capture"],
        seed=STUDY["seed"],
        code=steering_code("steering_horizons"),
    script:
        "scripts/steering_horizons.py"


rule steering_outcomes:
    """Collect the outcomes of all runs over the seeds, and all trajectories."""
    input:
        runs=expand(
            pattern(rules.steering_experiments.output.runs), seed=SEEDS, manoeuvre=MANOEUVRES
        ),
        stances=expand(
            pattern(rules.steering_experiments.output.stances), seed=SEEDS, manoeuvre=MANOEUVRES
        ),
        examples=expand(
            pattern(rules.steering_experiments.output.example), seed=1, manoeuvre=MANOEUVRES
        ),
        scores=expand(pattern(rules.steering_learn.output.scores), seed=SEEDS),
    output:
        outcomes=f"{STEERING_TABLES}/outcomes.csv",
        runs=f"{STEERING_TABLES}/runs.csv",
        trajectories=f"{STEERING_TABLES}/trajectories.csv",
        examples=f"{STEERING_TABLES}/examples.csv",
        scores=f"{STEERING_TABLES}/model_scores.csv",
    log:
        f"{STEERING}/logs/steering_outcomes.log",
    benchmark:
        f"{STEERING}/benchmarks/steering_outcomes.tsv"
    resources:
        **needs(minutes=10),
    params:
        code=steering_code("steering_outcomes"),
    script:
        "scripts/steering_outcomes.py"


rule steering_score:
    """Score pose, boom angle, stances and model against the truth of the simulation."""
    input:
        motion=of_first(rules.steering_learn.output.motion),
        stances=of_first(rules.steering_learn.output.stances),
        true_motion=of_first(f"{OF_SEED}/true_motion.csv"),
        true_stances=of_first(f"{OF_SEED}/true_stances.csv"),
        model=of_first(rules.steering_learn.output.model),
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
        code=steering_code("steering_score"),
    script:
        "scripts/steering_score.py"


rule steering_learning:
    """Tabulate the learned map, the hops it needs, and the effect of the kernel."""
    input:
        changes=of_first(rules.steering_learn.output.changes),
        model=of_first(rules.steering_learn.output.model),
    output:
        map=f"{STEERING_TABLES}/model_map.csv",
        printed_map=f"{STEERING_TABLES}/printed_map.csv",
        training=f"{STEERING_TABLES}/training_hops.csv",
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
        swing_limit_rad=STUDY["steering"]["robot"]["swing_limit_rad"],
        seed=STUDY["seed"],
        code=steering_code("steering_learning"),
    script:
        "scripts/steering_learning.py"


for kind in ("steering_model", *RUN_KINDS):
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
            DRAWING


rule steering_film:
    """Draw a typical run to the origin as an animated GIF."""
    input:
        film=of_first(rules.steering_experiments.output.film).format(manoeuvre="origin"),
        example=of_first(rules.steering_experiments.output.example).format(manoeuvre="origin"),
    output:
        film=f"{STEERING}/figures/steering_film.gif",
    log:
        f"{STEERING}/logs/steering_film.log",
    benchmark:
        f"{STEERING}/benchmarks/steering_film.tsv"
    resources:
        **needs(minutes=10),
    params:
        code=steering_code("steering_film"),
    script:
        "scripts/steering_film.py"


RUN_FILES = [path for kind in RUN_KINDS for path in getattr(rules, f"figures_{kind}").output]

# Contents of the page. A recorded robot has neither experiments nor truth.
STEERING_PAGE = {
    "figures": [
        *([] if STEERED else [*RUN_FILES, *rules.steering_film.output]),
        *rules.figures_steering_model.output,
    ],
    "captions": expand(
        f"{STEERING_CAPTIONS}/{{name}}.md",
        name=[
            *MODEL_FIGURES,
            *([] if STEERED else [*RUN_FIGURES, "steering_film"]),
        ],
    ),
    "recordings": list(rules.steering_learn.input) or [of_first(f"{OF_SEED}/excitation.h5")],
    "counts": of_first(rules.steering_learn.output.counts),
    "scores": (
        of_first(rules.steering_learn.output.scores)
        if STEERED
        else rules.steering_outcomes.output.scores
    ),
    **(
        {}
        if STEERED
        else {
            "outcomes": rules.steering_outcomes.output.outcomes,
            "horizons": rules.steering_horizons.output.table,
            "examples": rules.steering_outcomes.output.examples,
            "truth": rules.steering_score.output.truth,
        }
    ),
}


rule steering_report:
    """Write a page with all steering results and their provenance."""
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
        stage_times=stage_times(STEERING, seed=SEEDS, manoeuvre=MANOEUVRES),
        code=steering_code("steering_report"),
    script:
        "scripts/steering_report.py"


rule steering:
    """Make everything of chapter III: `snakemake --cores 2 steering`."""
    input:
        rules.steering_report.output,
