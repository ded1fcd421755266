"""Scenes: studied bodies that land on several feet (`hopdata.scenes.scene`)."""

from __future__ import annotations

from importlib.metadata import entry_points
from pkgutil import resolve_name
from typing import TYPE_CHECKING

from hopdata.errors import require_choice

if TYPE_CHECKING:
    from hopdata.scenes.scene import Scene

# Maps each name in the configuration to its parameter class. Classes are imported on
# demand, because they load a compiler. Installed packages add theirs by entry points
# (``hopdata.scenes``), but none that has the name of one of these.
SCENES = {entry.name: entry.value for entry in entry_points(group="hopdata.scenes")}
SCENES |= {
    "hopper": "hopdata.scenes.hopper_parameters:HopperParameters",
    "quadruped": "hopdata.scenes.quadruped:Quadruped",
}
STANDARD = "hopper"


def scene_class(name: str) -> type[Scene]:
    """Return the parameter class of a scene.

    Raises
    ------
    ConfigError
        If no scene has this name.
    """
    require_choice("simulation.scene", name, SCENES)
    found: type[Scene] = resolve_name(SCENES[name])
    return found
