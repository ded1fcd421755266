"""Write docs/troubleshooting.md: every message by its code, and what to do.

    python packaging/troubleshooting.py        writes it in a checkout (`make docs`)

The messages are those of the rooms (``messages.toml``). ``what_to_do.toml`` beside this
file has what to do, where the sentence does not say it itself. A test compares the page
with what would be written now.
"""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

CHECKOUT = Path(__file__).parents[1]
PAGE = CHECKOUT / "docs" / "troubleshooting.md"
WHAT_TO_DO = Path(__file__).with_name("what_to_do.toml")
#: The rooms whose sentences are only the labels of a page, and report no trouble.
LABELS = {"report"}
#: The rooms in the order in which a study meets them, and what each reports on.
ROOMS = {
    "foreign": "Files that are refused, and limits",
    "recordings": "Recordings",
    "landings": "Landings, contacts and quality",
    "maps": "Verdict",
    "inspecting": "An inspection",
    "commands": "Commands",
    "steering": "A drive",
}
HEAD = """\
# Troubleshooting

<!-- Written by `make docs` from the messages and packaging/what_to_do.toml. -->

After this page you know what a message means and what to do about it. Search it for the
message's words, or for its code in `verdict.json`. Words in braces are filled in. Where
the last column is empty, the sentence says what to do.

An **error** is one line, with exit code 1: the place, what was expected and found, and
what to do. `hopdata doctor` says what the installation lacks, and `results/STUDY/logs`
has a log of each job.
"""

TABLE = "| code | message | what to do |\n|---|---|---|\n"


def codes() -> dict[str, str]:
    """Return the template of each code, without those that are labels."""
    found = {}
    for path in sorted((CHECKOUT / "src" / "hopdata").glob("*/messages.toml")):
        room = path.parent.name
        if room in LABELS:
            continue
        for name, template in tomllib.loads(path.read_text("utf-8")).items():
            found[f"{room}.{name}"] = template
    return found


def what_to_do() -> dict[str, str]:
    """Return what to do about a code."""
    rooms = tomllib.loads(WHAT_TO_DO.read_text("utf-8"))
    return {
        f"{room}.{name}": text
        for room, names in rooms.items()
        for name, text in names.items()
    }


def _sections(room: str) -> Iterator[tuple[str, list[str]]]:
    """Yield each heading of a room's file with its codes, in the file's order."""
    text = (CHECKOUT / "src" / "hopdata" / room / "messages.toml").read_text("utf-8")
    title = "Others"
    names: list[str] = []
    for line in text.splitlines():
        if line.startswith("#"):
            if names:
                yield title, names
            title = line.lstrip("# ").split("; ")[0].rstrip(".:")
            names = []
        elif found := re.match(r"(\w+) = ", line):
            names.append(found[1])
    if names:
        yield title, names


def _cell(text: str) -> str:
    """Return a sentence as a cell of a table, with the names of its values alone."""
    plain = re.sub(r"\{(\w+)[^}]*\}", r"{\1}", text)
    plain = " ".join(plain.split())
    for sign in "|*<>":
        plain = plain.replace(sign, f"\\{sign}")
    return plain.strip("\\#; ")


def written() -> str:
    """Return the page as it should be."""
    templates = codes()
    done = what_to_do()
    parts = [HEAD]
    for room, title in ROOMS.items():
        parts.append(f"\n## {title}\n")
        for heading, names in _sections(room):
            parts.append(f"\n### {heading}\n\n{TABLE}")
            for name in names:
                code = f"{room}.{name}"
                cells = (f"`{code}`", _cell(templates[code]), done.get(code, ""))
                parts.append("| " + " | ".join(cells) + " |\n")
    return "".join(parts)


if __name__ == "__main__":
    PAGE.write_text(written(), encoding="utf-8")
