import tomllib

DISSERTATION = "results/dissertation"
DISSERTATION_PARTS = f"{DISSERTATION}/parts"
# This file's folder, relative to the working folder, so that a checkout can be moved.
DISSERTATION_FILES = Path(
    os.path.relpath(workflow.current_basedir.get_path_or_uri(secret_free=True))
)
# The module of each part, by its name.
DISSERTATION_CODE = {
    path.stem: path
    for path in sorted((DISSERTATION_FILES.parent / "parts").glob("*.py"))
    if not path.stem.startswith("_")
}


def dissertation_code(script, *modules):
    """Return a function that digests a script of the page and the library code that it uses."""
    return code(script, *modules, folder=DISSERTATION_FILES / "scripts")


def seconds_of(part):
    """Return about how long a part takes, s, as the file of its items says; 1 if it does not."""
    items = DISSERTATION_FILES.parent / "items" / f"{part}.toml"
    if not items.is_file():
        return 1
    return tomllib.loads(items.read_text("utf-8")).get("seconds", 1)
