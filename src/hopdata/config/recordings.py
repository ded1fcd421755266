"""What the configuration says of one recording."""

from __future__ import annotations

from typing import Any


def simulation_of(config: dict[str, Any], name: str) -> dict[str, Any]:
    """Return the block ``simulation`` as it holds for one recording.

    Parameters
    ----------
    config : dict
        As returned by `load_config`.
    name : str
        Name of the recording; its own values take the place of the block's where they are given.
    """
    own = next(entry["simulation"] for entry in config["recordings"] if entry["name"] == name)
    given = {key: value for key, value in own.items() if value is not None}
    return {**config["simulation"], **given}
