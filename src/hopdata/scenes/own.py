"""A scene that no package brings: MODULE:CLASS in the working folder, or an object.

No file may run code by itself, neither a configuration nor a recording with its truth,
and either may name a scene. So the module of a scene is imported only if the user has
said its name (`hopdata.foreign.working_folder.say`), or has imported it in Python.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from hopdata.errors import ArgumentError, ConfigError, require
from hopdata.foreign.plugins import own_code
from hopdata.foreign.working_folder import SAID, require_module, working_folder_last

if TYPE_CHECKING:
    from hopdata.scenes.scene import Scene

_KEY = "simulation.scene"

# Classes of scenes that were handed over as objects, by their names.
_HANDED_OVER: dict[str, type[Scene]] = {}


def own_class(name: str) -> type[Scene]:
    """Return the class of a scene by MODULE:CLASS.

    Raises
    ------
    ConfigError
        If the user has not said this name, or there is no scene of this name.
    """
    if name in _HANDED_OVER:
        return _HANDED_OVER[name]
    module, _, attribute = name.partition(":")
    is_said = os.environ.get(SAID) == name or module in sys.modules
    wanted = f"--scene {name} in the command, or the variable {SAID}={name}"
    found = "its name in a file alone, which may not run code"
    require(is_said, _KEY, wanted, found)
    with working_folder_last():
        require_module(module, _KEY)
        with own_code(f"the scene {name}", _KEY):
            __import__(module)
    return _checked(name, getattr(sys.modules[module], attribute, None))


def _checked(name: str, found: Any) -> type[Scene]:
    """Return what a name stands for, if it is the class of a scene."""
    from hopdata.scenes.scene import Scene

    module, _, attribute = name.partition(":")
    wanted = "a class that derives from hopdata.scenes.scene.Scene"
    if found is None:
        others = _scenes_in(module)
        has = f"; it has {', '.join(others)}" if others else ""
        raise ConfigError.at(_KEY, wanted, f"no '{attribute}' in {module}{has}")
    if not (isinstance(found, type) and issubclass(found, Scene)):
        raise ConfigError.at(_KEY, wanted, f"{name}, which is none")
    left_out = sorted(getattr(found, "__abstractmethods__", ()))
    if left_out:
        what = f"a scene that defines {', '.join(left_out)}"
        raise ConfigError.at(_KEY, what, f"{name}, which does not")
    return found


def _scenes_in(module: str) -> list[str]:
    """Return the names of the scenes that a module defines."""
    from hopdata.scenes.scene import Scene

    return [
        name
        for name, one in vars(sys.modules[module]).items()
        if isinstance(one, type) and issubclass(one, Scene) and one.__module__ == module
    ]


def handed_over(scene: object, known: Mapping[str, str]) -> tuple[str, dict[str, Any]]:
    """Return the name of a scene that is given as an object, and its parameters.

    Parameters
    ----------
    scene : Scene
    known : mapping
        Places of the scenes that have names of their own, by these names.

    Raises
    ------
    ArgumentError
        If it is no scene.
    """
    from hopdata.scenes.scene import Scene

    wanted = "the name of a scene, or an object of a class that derives from Scene"
    if isinstance(scene, type):
        raise ArgumentError.at("scene", wanted, f"a class; write {scene.__name__}()")
    if not isinstance(scene, Scene):
        raise ArgumentError.at("scene", wanted, f"one of type {type(scene).__name__}")
    values = {one.name: getattr(scene, one.name) for one in fields(scene)}
    kind = type(scene)
    name = f"{kind.__module__}:{kind.__qualname__}"
    for short, place in known.items():
        if place == name:
            return short, values
    _HANDED_OVER[name] = kind
    return name, values
