"""Products beside the study, which an installation may lack: what each of them brings.

A product is a package that has rooms like hopdata's own. What it brings stands in files
at fixed places in its folder, all of which may be missing:

- ``config/schema.yaml``: one block of the configuration, named as the product;
- ``config/consistency.py``: ``mistakes(config)`` yields what does not fit in the block;
- ``commands/commands.toml``: commands, as in ``hopdata/commands/commands.toml``, and
  targets, which ``hopdata run`` makes by their names;
- ``figures/catalogue.toml``: figures, as in ``hopdata/figures/catalogue.toml``;
- ``workflow/rules.smk``: rules, included in the workflow after those of the study.

Products are found by their entry points in the group `GROUP`: the name is that of the
block, the value that of the package. Only files are read, and no module of a product is
imported before a user asks for something of it.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

#: Group of the entry points.
GROUP = "hopdata.products"


@dataclass(frozen=True)
class Product:
    """A product that is installed.

    Attributes
    ----------
    name
        Its block in the configuration, and its extra of the installation.
    package
        Its package, by its dotted name.
    folder
        The folder of the package.
    """

    name: str
    package: str
    folder: Path

    @property
    def rules(self) -> Path:
        """The file with the product's rules."""
        return self.folder / "workflow" / "rules.smk"

    @property
    def catalogue(self) -> Path:
        """The file that lists the product's figures."""
        return self.folder / "figures" / "catalogue.toml"

    def block(self) -> dict[str, Any]:
        """Return the schema of the product's block by its name; empty without one."""
        import yaml

        file = self.folder / "config" / "schema.yaml"
        if not file.is_file():
            return {}
        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        found: dict[str, Any] = yaml.load(file.read_text("utf-8"), Loader=loader)
        return found

    def commands(self) -> dict[str, dict[str, Any]]:
        """Return the product's commands by name."""
        return self._of_command_line("commands")

    def targets(self) -> dict[str, dict[str, Any]]:
        """Return what ``hopdata run`` makes of the product, beside studies.

        Each has the name of a rule and of a folder of results, and a ``summary``.
        """
        return self._of_command_line("targets")

    def _of_command_line(self, kind: str) -> dict[str, dict[str, Any]]:
        file = self.folder / "commands" / "commands.toml"
        if not file.is_file():
            return {}
        found: dict[str, Any] = tomllib.loads(file.read_text("utf-8"))
        entries: dict[str, dict[str, Any]] = found.get(kind, {})
        return entries

    def mistakes(self, config: Mapping[str, Any]) -> Iterable[str]:
        """Return what does not fit in the product's block; this imports the product."""
        if not (self.folder / "config" / "consistency.py").is_file():
            return ()
        check = resolve_name(f"{self.package}.config.consistency:mistakes")
        found: Iterable[str] = check(config)
        return found


@cache
def _declared() -> Mapping[str, Product | None]:
    """Return the products of the entry points; None where the package is missing."""
    products: dict[str, Product | None] = {}
    for entry in entry_points(group=GROUP):
        folder = _folder_of(entry.value)
        if folder is None:
            products[entry.name] = None
        else:
            products[entry.name] = Product(entry.name, entry.value, folder)
    return products


def _folder_of(package: str) -> Path | None:
    """Return the folder of a package without importing it; None if it is missing."""
    try:
        spec = find_spec(package)
    except ModuleNotFoundError:  # of the package that it is in
        return None
    # A folder that was emptied, but not deleted, is a package without a file.
    if spec is None or spec.origin is None:
        return None
    return Path(spec.origin).parent


def installed() -> tuple[Product, ...]:
    """Return the products that are there."""
    return tuple(one for one in _declared().values() if one is not None)


def is_missing(name: str) -> bool:
    """Tell whether a product of this name exists but is not installed."""
    return name in _declared() and _declared()[name] is None
