"""Tell what an installation brings: packages, MB, and through which of hopdata's needs.

    python -m venv /tmp/fresh && /tmp/fresh/bin/pip install hopdata
    /tmp/fresh/bin/python packaging/installed.py

It runs in the environment that it tells of. What a need "brings" is itself and all that
comes through it; "alone" counts what would go if hopdata did not need it, since nothing
else of it asks for that either.
"""

import argparse
import importlib.metadata
import re
from pathlib import Path

MB = 1e6


def plain(name):
    """Return the name of a package as indices write it."""
    """Return a name as registries compare them."""
    return re.sub("[-_.]+", "-", name).lower()


def needs(name, extra=""):
    """Return the packages that one needs here, by plain name."""
    from packaging.requirements import Requirement

    try:
        wanted = importlib.metadata.requires(name) or ()
    except importlib.metadata.PackageNotFoundError:
        return set()
    found = set()
    for text in wanted:
        one = Requirement(text)
        if one.marker is None or one.marker.evaluate({"extra": extra}):
            found.add(plain(one.name))
    return found


def reached(name):
    """Return a package and all that come through it."""
    found, waiting = set(), [name]
    while waiting:
        one = waiting.pop()
        if one not in found:
            found.add(one)
            waiting += needs(one)
    return found


def size_mb(distribution):
    """Return the size of a package's files on disk, with their compiled modules."""
    total = 0
    for file in distribution.files or ():
        place = Path(str(distribution.locate_file(file)))
        if place.is_file():
            total += place.stat().st_size
    return total / MB


def table(sizes):
    """Return the table as Markdown, the largest first."""
    head = "| need | brings | MB | alone | MB | the largest that it brings alone, MB |"
    lines = [head, "|---|--:|--:|--:|--:|---|"]
    own = needs("hopdata")
    brought = {name: reached(name) & set(sizes) for name in own}

    def total(names):
        return sum(sizes[name] for name in names)

    for name in sorted(own, key=lambda one: -total(brought[one])):
        others = set().union(*(brought[one] for one in own - {name}))
        alone = brought[name] - others
        beside = sorted(alone - {name}, key=lambda one: -sizes[one])[:3]
        most = ", ".join(f"{one} {sizes[one]:.1f}" for one in beside)
        cells = [name]
        for some in (brought[name], alone):
            cells += [str(len(some)), f"{total(some):.1f}"]
        lines.append(f"| {' | '.join(cells)} | {most} |")
    whole = set().union(*brought.values(), {"hopdata"})
    lines.append(f"| hopdata itself | 1 | {sizes['hopdata']:.1f} | | | |")
    lines.append(f"| all | {len(whole)} | {total(whole):.1f} | | | |")
    return "\n".join(lines)


def main():
    """Print the table."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    sizes = {
        plain(one.metadata["Name"]): size_mb(one)
        for one in importlib.metadata.distributions()
    }
    print(table(sizes))


if __name__ == "__main__":
    main()
