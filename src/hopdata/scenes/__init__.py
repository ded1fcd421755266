"""Scenes: studied bodies that land on several feet (`hopdata.scenes.scene`)."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from pkgutil import resolve_name
from typing import TYPE_CHECKING

from hopdata.errors import require_choice
from hopdata.foreign.plugins import blamed, name_of, own_code, plugins
from hopdata.foreign.working_folder import is_own
from hopdata.scenes.own import own_class

if TYPE_CHECKING:
    from hopdata.scenes.scene import Scene

# Maps each name in the configuration to its parameter class. Classes are imported on
# demand, because they load a compiler. Installed packages add theirs by entry points
# (``hopdata.scenes``), but none that has the name of one of these.
_OWN = {
    "hopper": "hopdata.scenes.hopper_parameters:HopperParameters",
    "quadruped": "hopdata.scenes.quadruped:Quadruped",
}
_PLUGINS = plugins("hopdata.scenes", "scene", _OWN)
SCENES = {name: entry.value for name, entry in _PLUGINS.items()} | _OWN
STANDARD = "hopper"


def blamed_scene(name: str) -> AbstractContextManager[None]:
    """Return a context in which errors of another package's scene are told as such."""
    if is_own(name):
        return own_code(f"the scene {name}", "simulation.scene")
    if name not in _PLUGINS:
        return nullcontext()
    return blamed(name_of("scene", _PLUGINS[name]), "simulation.scene")


def scene_class(name: str) -> type[Scene]:
    """Return the parameter class of a scene.

    Parameters
    ----------
    name : str
        A name of `SCENES`, or MODULE:CLASS (`hopdata.scenes.own`).

    Raises
    ------
    ConfigError
        If no scene has this name, or the package that brings it fails.
    """
    if is_own(name):
        return own_class(name)
    require_choice("simulation.scene", name, SCENES)
    with blamed_scene(name):
        found: type[Scene] = resolve_name(SCENES[name])
    return found
