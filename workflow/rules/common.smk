import os
import re
import sys
from functools import cache
from pathlib import Path

from snakemake.io import strip_wildcard_constraints

from hopdata import stages
from hopdata.config import consistency
from hopdata.config.consistency import files_of
from hopdata.config.loading import load_config
from hopdata.config.schema import load_schema
from hopdata.errors import HopdataError
from hopdata.figures.catalogue import FIGURES as CATALOGUE, OF_DISTANCES, source_of, tables_of
from hopdata.provenance import code_digest, own_code, stage_digest

# Snakemake writes Python's path unquoted into the shell command of each script.
if re.search(r"[\s'\"()&;]", sys.executable):
    sys.exit(
        "hopdata: error: Python: expected a path without spaces, quotes and brackets (Snakemake "
        f"does not quote it), found '{sys.executable}'; keep the environment elsewhere, "
        "for example: make figures VENV=$HOME/.hopdata"
    )

try:
    STUDY = load_config(config, files=workflow.overwrite_configfiles or workflow.configfiles)
except HopdataError as error:
    sys.exit(f"hopdata: error: {error}")

RESULTS = f"results/{STUDY['study']}"
for folder in ("results", RESULTS):
    if os.path.exists(folder) and not os.path.isdir(folder):
        sys.exit(
            f"hopdata: error: {folder}: expected a folder for the results, found a file; move it "
            "away, or give the study another name"
        )
SOURCES = {entry["name"]: files_of(entry) for entry in STUDY["recordings"]}
begin(STUDY["study"], (file for files in SOURCES.values() for file in files), RESULTS)
RECORDINGS = list(SOURCES)
METHOD = STUDY["touchdowns"]["method"]
METHODS = load_schema()["properties"]["touchdowns"]["properties"]["method"]["enum"]
# All methods are scored where there is a truth to score them against.
TRUTH_KNOWN = consistency.knows_truth(STUDY)
LABELLED_BY = METHODS if TRUTH_KNOWN else [METHOD]
# Whether the study asks for constraint subspaces and their distances (Fig. 2.5).
DISTANCES = STUDY["distances"]["enabled"]
SIMULATED = consistency.is_simulated(STUDY)
# Digests of the files of the user's scene, and the scripts that call it.
OWN_CODE = own_code(STUDY)
OF_SCENES = ("scaling_study", "true_sections")
# Contacts known from other sources or marked in its own file, for the recordings that have any.
EXTERNAL = consistency.external_blocks(STUDY)
# Whether short gaps of the body are filled.
FILLS = consistency.fills(STUDY)
FORMATS = STUDY["figures"]["formats"]
# Paths start from this file: if another workflow includes this one as a module, the Snakefile is its
# own. They are relative, so that a study can run in another folder (`--directory`) and a checkout
# can be moved.
HERE = Path(workflow.current_basedir.get_path_or_uri(secret_free=True))
CHECKOUT = Path(os.path.relpath(HERE.parents[1]))
SCRIPTS = CHECKOUT / "workflow" / "scripts"
CAPTIONS = CHECKOUT / "workflow" / "captions"
PROGRAMS = CHECKOUT / "benchmarks"
STRESS_SUITE = CHECKOUT / "tests" / "hybrid"  # run by the benchmark `stress`
DAMAGE_SUITE = CHECKOUT / "tests" / "recordings"  # used by the benchmark `reading`


wildcard_constraints:
    recording="|".join(RECORDINGS),
    method="|".join(METHODS),


def in_recordings(key):
    """Return a key of ``recordings`` for each of them, by name."""
    return {entry["name"]: entry[key] for entry in STUDY["recordings"]}


def all_but(section, *left_out):
    """Return a section of the configuration without some of its keys."""
    return {key: value for key, value in section.items() if key not in left_out}


def source_files(wildcards):
    """Return the user's files of a recording, or the simulated one if it has none."""
    files = SOURCES[wildcards.recording]
    if files:
        return files
    return f"{RESULTS}/simulated/{wildcards.recording}.h5"


def source_stamps(wildcards):
    """Return sizes and times of the user's files of a recording."""
    return stamps(SOURCES[wildcards.recording])


def stage_code(name):
    """Return a function that digests a stage: its text, and the library code that it uses.

    See `code`. Other stages in the same file do not count. A scene in the working folder counts in
    the stage that simulates it.
    """
    digest = cache(lambda: stage_digest(*stages.LINE.sources(name), script=SCRIPTS / "stage.py"))
    if name == "simulate" and OWN_CODE:
        return lambda wildcards: [digest(), OWN_CODE]
    return lambda wildcards: digest()


def code(script, *modules, folder=SCRIPTS):
    """Return a function that digests a script, the given modules and the library code they use.

    A rule runs again when the digest changes. It is computed only if the rule has planned jobs, and
    once for all of them, because reading all the code takes a second.
    """
    digests = cache(lambda: [code_digest(path) for path in (folder / f"{script}.py", *modules)])
    if script in OF_SCENES and OWN_CODE:
        return lambda wildcards: [*digests(), OWN_CODE]
    return lambda wildcards: digests()


def needs(*, minutes, mb_a_mb=0):
    """Return the memory and time that a job requests on a cluster; each retry doubles both."""

    def memory(wildcards, input, attempt):
        if all(map(os.path.exists, input)):
            size_mb = input.size_mb
        else:  # Earlier jobs of the group write the inputs: use the size of the recordings.
            names = [wildcards.recording] if "recording" in wildcards.keys() else RECORDINGS
            files = [file for name in names for file in SOURCES[name] if os.path.exists(file)]
            size_mb = sum(map(os.path.getsize, files)) / 1e6
        return (800 + int(mb_a_mb * size_mb)) * 2 ** (attempt - 1)

    return {
        "mem_mb": memory,
        "runtime": lambda wildcards, attempt: minutes * 2 ** (attempt - 1),
    }


def stage_times(folder, **wildcards):
    """Return the files with the run times of the jobs of a study, or of a product in its folder.

    Rules that are defined later are left out.
    """
    times = [strip_wildcard_constraints(one.benchmark) for one in workflow.rules if one.benchmark]
    own = [one for one in times if one.startswith(f"{folder}/benchmarks/")]
    return sorted(set(expand(own, recording=RECORDINGS, method=LABELLED_BY, **wildcards)))


def each_recording(pattern):
    """Return one path per recording, in the order of the configuration."""
    return expand(pattern, recording=RECORDINGS)


def sources(name, folders=(PROGRAMS, STRESS_SUITE, STRESS_SUITE / "stress", DAMAGE_SUITE)):
    """Return a program and its local imports, direct or indirect; packages are included whole."""
    program = PROGRAMS / f"{name}.py"
    folders = (program.parent, *folders)
    found, waiting = set(), [program]
    while waiting:
        file = waiting.pop()
        found.add(file)
        for module in re.findall(r"^(?:from|import) (\w+)", file.read_text(), re.MULTILINE):
            for folder in folders:
                files = {folder / f"{module}.py", *(folder / module).glob("*.py")}
                waiting += [one for one in files - found if one.is_file()]
    return sorted(found)


def drawer_of(figure):
    """Return the program that draws a figure of the benchmarks."""
    product = os.path.dirname(figure)
    return PROGRAMS / product / f"{product or 'benchmark'}_figures.py"


def captions_of(figures):
    """Return the captions of figures of the benchmarks."""
    captions = []
    for figure in figures:
        product, name = os.path.split(figure)
        captions.append(f"{PROGRAMS / product / 'captions' if product else CAPTIONS}/{name}.md")
    return captions
