"""Compare the commits by which workflows name actions with the tags that they state.

python packaging/pins.py    asks the hosts of the actions; needs git and a network
"""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
WORKFLOWS = ROOT / ".github" / "workflows"
HOST = "https://github.com/"
PIN = re.compile(r"([\w.-]+/[\w.-]+)@([0-9a-f]{40})\s+# (v[\w.]+)")


def pins(text: str) -> list[tuple[str, str, str]]:
    """Return action, commit and stated tag of each pin; others are refused."""
    found = []
    for line in re.findall(r"uses:\s*(.+)", text):
        pin = re.fullmatch(
            r"([\w.-]+/[\w.-]+)@([0-9a-f]{40})\s+# (v[\w.]+)", line.strip()
        )
        if pin is None:
            raise ValueError(f"expected 'owner/action@commit  # tag', found '{line}'")
        found.append((pin[1], pin[2], pin[3]))
    return found


def commit_of(action: str, tag: str, host: str = HOST) -> str:
    """Return the commit of a tag, also of an annotated one, which has two lines."""
    names = [f"refs/tags/{tag}", f"refs/tags/{tag}^{{}}"]
    said = subprocess.run(
        ["git", "ls-remote", host + action, *names],
        capture_output=True,
        check=True,
        encoding="utf-8",
    )
    commits = {line.split()[1]: line.split()[0] for line in said.stdout.splitlines()}
    return commits.get(names[1], commits.get(names[0], ""))


def main() -> int:
    """Print each pin that is not at its tag; return 1 if there is one."""
    wrong = 0
    texts = [path.read_text(encoding="utf-8") for path in WORKFLOWS.glob("*.yml")]
    for action, commit, tag in sorted({pin for text in texts for pin in pins(text)}):
        found = commit_of(action, tag)
        if found != commit:
            wrong += 1
            print(
                f"{action}: expected {tag} at {commit}, found {found or 'no such tag'}"
            )
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
