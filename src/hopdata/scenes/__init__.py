"""Scenes: bodies that land on several feet, and can be studied (`hopdata.scenes.scene`)."""

from __future__ import annotations

from importlib.metadata import entry_points
from pkgutil import resolve_name
from typing import TYPE_CHECKING

from hopdata.errors import require_choice

if TYPE_CHECKING:
    from hopdata.scenes.scene import Scene

#: Name in the configuration -> class of the parameters. Loaded when asked for: compilers are slow.
#: Those of installed packages (``hopdata.scenes``) are found by their entry points.
SCENES = {
    "hopper": "hopdata.scenes.hopper_parameters:HopperParameters",
    "quadruped": "hopdata.scenes.quadruped:Quadruped",
}
SCENES = {e.name: e.value for e in entry_points(group="hopdata.scenes")} | SCENES
STANDARD = "hopper"


def scene_class(name: str) -> type[Scene]:
    """Return the class of a scene's parameters.

    Raises
    ------
    ConfigError
        If there is no scene of this name.
    """
    require_choice("simulation.scene", name, SCENES)
    found: type[Scene] = resolve_name(SCENES[name])
    return found
