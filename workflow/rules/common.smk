import sys
from pathlib import Path

from hopdata.config import load_config
from hopdata.errors import HopdataError
from hopdata.provenance import code_digest

try:
    STUDY = load_config(config, files=workflow.overwrite_configfiles or workflow.configfiles)
except HopdataError as error:
    sys.exit(f"hopdata: error: {error}")

RESULTS = f"results/{STUDY['study']}"
SOURCES = {entry["name"]: entry.get("file") for entry in STUDY["recordings"]}
RECORDINGS = list(SOURCES)
METHOD = STUDY["touchdowns"]["method"]
SCORED_METHODS = list(dict.fromkeys([METHOD, "kink", "velocity_minimum"]))  # the study's own first
SCRIPTS = Path(workflow.basedir) / "workflow" / "scripts"


wildcard_constraints:
    recording="|".join(RECORDINGS),
    method="kink|velocity_minimum|velocity_minimum_parabola",


def code(script):
    """Digest of a script and the library code it uses: a rule runs again when it changes."""
    return code_digest(SCRIPTS / f"{script}.py")


def each_recording(pattern):
    """One path a recording, in the order of the config."""
    return expand(pattern, recording=RECORDINGS)
