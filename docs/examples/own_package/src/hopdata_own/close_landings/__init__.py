"""A product: which landings have all their contacts within a few milliseconds."""


def close_landings(touchdowns, *, at_most_ms):
    """Return the landings, a row each, that are used and whose contacts are close."""
    is_used = touchdowns["reason"].isna()
    is_close = 1e3 * touchdowns["spread_s"] <= at_most_ms
    return touchdowns[is_used & is_close]
