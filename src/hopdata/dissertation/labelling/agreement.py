"""Whether what is measured here agrees with what the text says."""

from hopdata.dissertation.rows import Agreement

#: Relative difference up to which a measured number agrees with a printed one that has
#: two digits.
#: Unit: 1. Origin: chosen.
CLOSE = 0.1

#: Share of frames or landings that counts as all, where the text says "any" or "all".
#: Unit: 1. Origin: chosen.
NEARLY_ALL = 0.99

#: Share of frames from which a section is partly one that the text ensures.
#: Unit: 1. Origin: chosen.
MOST = 0.9


def agrees(holds: bool, otherwise: Agreement = Agreement.DIFFERS) -> Agreement:
    """Return that print and result agree if they do, else the other answer."""
    if holds:
        return Agreement.AGREES
    return otherwise


def built(holds: bool) -> Agreement:
    """Return that a design or a rule is built, if it does what it should."""
    if holds:
        return Agreement.BUILT
    return Agreement.DIFFERS


def close(found: float, printed: float) -> bool:
    """Return whether a measured number agrees with a printed one."""
    return abs(found / printed - 1) <= CLOSE
