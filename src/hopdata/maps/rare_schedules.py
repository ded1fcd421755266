"""What is said of schedules with too few landings: one by one, or together where they are many."""

from __future__ import annotations

from collections.abc import Mapping

Notes = list[dict[str, str]]

MOST_ONE_BY_ONE = 6


def rare_notes(what: str, sizes: Mapping[str, int], wanted: str) -> Notes:
    """Note the schedules that are left out.

    Parameters
    ----------
    what
        What they do not have, such as ``"subspaces"``.
    sizes
        Schedule -> number of its landings.
    wanted
        How many it takes, in words.

    Returns
    -------
    list
        ``{"what", "reason"}`` of each schedule, or, of more than six, of all together: six feet may
        show hundreds of schedules of a landing or two.
    """
    if len(sizes) <= MOST_ONE_BY_ONE:
        return [
            {"what": f"{what} of schedule {name}", "reason": f"{size} touchdowns, {wanted}"}
            for name, size in sizes.items()
        ]
    counts = sizes.values()
    reason = f"{min(counts)} to {max(counts)} touchdowns each, {sum(counts)} in all, {wanted}"
    return [{"what": f"{what} of {len(sizes)} schedules", "reason": reason}]
