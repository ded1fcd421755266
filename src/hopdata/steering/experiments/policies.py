"""Who steers: the printed controller, the one that is recommended, and one that knows the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

from hopdata.errors import chosen
from hopdata.steering.control.globalised import GlobalisedController
from hopdata.steering.control.objectives import Horizon, Objective, ToHeading, ToPoint
from hopdata.steering.control.plan import Controller
from hopdata.steering.control.planner import planner
from hopdata.steering.control.printed import PrintedController
from hopdata.steering.experiments.tasks import ANY, FACING, to_origin
from hopdata.steering.models.interface import FrameChangeMap
from hopdata.steering.models.tabulated import TabulatedMap
from hopdata.steering.plant.true_map import TrueFrameChanges

Policy: TypeAlias = Callable[[Objective], Controller]

PRINTED, PLANNER, GLOBALISED, CEILING = "printed", "planner", "globalised", "ceiling"


def policies(
    options: Mapping[str, Any],
    manoeuvre: str,
    *,
    models: Sequence[FrameChangeMap],
    truth: TrueFrameChanges,
    swing_limit_rad: float,
) -> dict[tuple[str, str], list[Policy]]:
    """Return what makes a controller for a goal, by start and name of the controller.

    There is one for each model, with which the starts take turns.

    Parameters
    ----------
    options : mapping
        The config's ``steering.control``.
    manoeuvre : {"origin", "turn"}
    models : sequence of FrameChangeMap
        What was learned, from one set of hops each.
    truth : TrueFrameChanges
        What the ceiling knows: the true frame change, averaged over the swing before.
    swing_limit_rad : float
    """
    horizon = Horizon(hops=options["horizon"], swing_limit_rad=swing_limit_rad)
    true_map = TabulatedMap(truth.average(), swing_limit_rad)

    printed = [_printed(model, horizon) for model in models]
    starts = {(FACING, PRINTED): printed} if to_origin(manoeuvre) else {}
    return starts | {
        (ANY, PRINTED): printed,
        (ANY, options["controller"]): [
            _recommended(options, manoeuvre, model, horizon) for model in models
        ],
        (ANY, CEILING): [_recommended(options, manoeuvre, true_map, horizon)],
    }


def _printed(model: FrameChangeMap, horizon: Horizon) -> Policy:
    return PrintedController(model=model, horizon=horizon).towards


def _recommended(
    options: Mapping[str, Any], manoeuvre: str, model: FrameChangeMap, horizon: Horizon
) -> Policy:
    """Return what makes the recommended controller; what takes long is computed here, once."""
    make = chosen("steering.control.controller", options["controller"], CONTROLLERS)
    return make(options, manoeuvre, model, horizon)


def _planner(
    options: Mapping[str, Any], manoeuvre: str, model: FrameChangeMap, horizon: Horizon
) -> Policy:
    return planner(
        model,
        ToPoint() if to_origin(manoeuvre) else ToHeading(),
        horizon=replace(horizon, hops=options["planner_horizon"]),
    ).towards


def _globalised(
    _options: Mapping[str, Any], _manoeuvre: str, model: FrameChangeMap, horizon: Horizon
) -> Policy:
    return GlobalisedController(model=model, horizon=horizon).towards


CONTROLLERS = {PLANNER: _planner, GLOBALISED: _globalised}
