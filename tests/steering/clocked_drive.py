"""A drive of `hopdata drive` on a simulated clock, in place of the one in real time."""

from hopdata.steering.live.simulated_time import drive_in_simulated_time

#: What a drive in real time takes beside: who looks at it, and who stops it.
IN_REAL_TIME = ("stop", "armed", "on_look", "rest_without_log")


def on_a_simulated_clock(geometry, controller, boom, *, stream, **options):
    """Drive as `hopdata.steering.live.drive.drive` does, without waiting or looking."""
    for name in IN_REAL_TIME:
        options.pop(name)
    return drive_in_simulated_time(geometry, controller, boom, stream.source, **options)
