"""Scenes: vector fields with guards, ready for the hybrid integrator.

Those of `SCENES` land on several feet and can be studied (`hopdata.scenes.scene`); the others are
examples of the integrator.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from hopdata.errors import require_choice

if TYPE_CHECKING:
    from hopdata.scenes.scene import Scene

#: Name in the configuration -> class of the parameters. Loaded when asked for: compilers are slow.
SCENES = {
    "hopper": "hopdata.scenes.hopper_parameters:HopperParameters",
    "quadruped": "hopdata.scenes.quadruped:Quadruped",
}
STANDARD = "hopper"


def scene_class(name: str) -> type[Scene]:
    """Return the class of a scene's parameters.

    Raises
    ------
    ConfigError
        If there is no scene of this name.
    """
    require_choice("simulation.scene", name, SCENES)
    module, _, kind = SCENES[name].partition(":")
    found: type[Scene] = getattr(import_module(module), kind)
    return found
