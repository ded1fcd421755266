"""Products beside the study, which an installation may lack: what each of them brings.

A product is a package that has rooms like hopdata's own. What it brings stands in files
at fixed places in its folder, all of which may be missing:

- ``config/schema.yaml``: one block of the configuration, named as the product;
- ``config/consistency.py``: ``mistakes(config)`` yields what does not fit in the block;
- ``commands/commands.toml``: commands, as in ``hopdata/commands/commands.toml``, and
  targets, which ``hopdata run`` makes by their names; and ``[extras]``, the texts by
  which ``hopdata doctor`` says what an extra of the installation brings it;
- ``figures/catalogue.toml``: figures, as in ``hopdata/figures/catalogue.toml``;
- ``workflow/rules.smk``: rules, included in the workflow after those of the study.

Products are found by their entry points in the group `GROUP`: the name is that of the
block, the value that of the package. Only files are read, and no module of a product is
imported before a user asks for something of it.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from hopdata.errors import ConfigError, HopdataError
from hopdata.foreign.plugins import blamed, name_of
from hopdata.messages import Message

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

    def extras(self) -> dict[str, str]:
        """Return what extras of the installation bring the product, by their names."""
        texts = self._of_command_line("extras")
        return {name: str(text) for name, text in texts.items()}

    def _of_command_line(self, kind: str) -> dict[str, Any]:
        file = self.folder / "commands" / "commands.toml"
        if not file.is_file():
            return {}
        found: dict[str, Any] = tomllib.loads(file.read_text("utf-8"))
        entries: dict[str, Any] = found.get(kind, {})
        return entries

    def mistakes(self, config: Mapping[str, Any]) -> Iterable[str]:
        """Return what does not fit in the product's block; this imports the product."""
        if not (self.folder / "config" / "consistency.py").is_file():
            return ()
        with self.blamed():
            check = resolve_name(f"{self.package}.config.consistency:mistakes")
            found: Iterable[str] = check(config)
            return [*found]

    def blamed(self) -> AbstractContextManager[None]:
        """Return a context in which errors are told as those of the product.

        hopdata's own products are no foreign code: their errors keep their traceback.
        """
        if self.package.partition(".")[0] == __name__.partition(".")[0]:
            return nullcontext()
        return blamed(f"the product '{self.name}' ({self.package})", self.name)


@cache
def _declared() -> Mapping[str, Product | None]:
    """Return the products of the entry points; None where the package is missing."""
    products: dict[str, Product | None] = {}
    # hopdata's own first, so that no other package takes their names.
    own_first = sorted(entry_points(group=GROUP), key=lambda entry: not _is_own(entry))
    for entry in own_first:
        if entry.name in products:
            values = {"plugin": name_of("product", entry), "used": "another one"}
            _FAULTS[entry.name] = str(Message("foreign.clash", values))
            continue
        try:
            with blamed(name_of("product", entry), entry.name):
                products[entry.name] = _sound_product(entry)
        except HopdataError as error:
            # A package that does not work must not end commands that do not need it.
            products[entry.name] = None
            _FAULTS[entry.name] = str(error)
    return products


def _is_own(entry: EntryPoint) -> bool:
    return entry.value.partition(".")[0] == __name__.partition(".")[0]


#: Why products that are installed cannot be used, by name.
_FAULTS: dict[str, str] = {}


def faults() -> Mapping[str, str]:
    """Return why products that are installed cannot be used, by name."""
    _declared()
    return _FAULTS


def _sound_product(entry: EntryPoint) -> Product | None:
    """Return a product whose files can be read; None if its package is missing."""
    folder = _folder_of(entry.value)
    if folder is None:
        return None
    product = Product(entry.name, entry.value, folder)
    for name, command in product.commands().items():
        missing = {"run", "summary", "description", "examples"} - {*command}
        if missing:
            raise ConfigError.at(
                f"{name} in {folder / 'commands' / 'commands.toml'}",
                "a command with run, summary, description and examples",
                f"none with {', '.join(sorted(missing))}",
            )
    for target in product.targets().values():
        target["summary"]
    return product


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
