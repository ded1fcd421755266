STEERING = f"{RESULTS}/steering"
# This file's folder, relative to the working folder, so that a checkout can be moved.
STEERING_FILES = Path(os.path.relpath(workflow.current_basedir.get_path_or_uri(secret_free=True)))
STEERING_CAPTIONS = STEERING_FILES / "captions"
# The script that draws the figures of all jobs; a rule's script is found from this file's folder.
DRAWING = os.path.relpath(SCRIPTS / "figures.py", STEERING_FILES)
STEERED = STUDY["steering"]["recordings"]
STEERING_TABLES = f"{STEERING}/tables"
# Each seed has a folder with the learned model and the experiments of each manoeuvre. A recorded
# robot has a single folder, with the learned model only. Observations after the first have their
# own folders, such as `seeds/1_printed`.
OF_SEED = f"{STEERING}/seeds/{{seed}}"
SEEDS = [
    f"{seed}_{observation}" if other else str(seed)
    for other, observation in enumerate(STUDY["steering"]["observations"])
    for seed in range(1, 2 if STEERED else STUDY["steering"]["experiments"]["seeds"] + 1)
]
# Way-points are a manoeuvre, with a figure of its own, if any are given.
WAY_POINTS = STUDY["steering"]["experiments"]["waypoints_m"]
MANOEUVRES = ["origin", "turn", *(["waypoints"] if WAY_POINTS else [])]
RUN_KINDS = ["steering_runs", *(["steering_waypoints"] if WAY_POINTS else [])]
MODEL_FIGURES = list(CATALOGUE["steering_model"])
RUN_FIGURES = [name for kind in RUN_KINDS for name in CATALOGUE[kind]]


def steering_code(script):
    """Return a function that digests a script of steering and the library code that it uses."""
    return code(script, folder=STEERING_FILES / "scripts")


def pattern(output):
    """Return the pattern of a rule's output as the rule states it, for `expand`.

    Where files are kept in an object storage (`--default-storage-prefix`), Snakemake has put the
    place of the local copy there.
    """
    if not getattr(output, "is_storage", False):
        return str(output)
    prefix = workflow.storage_settings.default_storage_prefix
    return output.storage_object.query.removeprefix(f"{prefix}/")


def of_first(output):
    """Return the file of the first seed, whose runs and model a steering study shows."""
    return expand(pattern(output), seed=1, allow_missing=True)[0]
