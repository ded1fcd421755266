"""A drive of `hopdata drive` on a simulated clock, in place of the one in real time."""

from types import SimpleNamespace

from hopdata.messages import Message
from hopdata.steering.live.clocked import ClockedDrive
from hopdata.steering.live.loop import checks_of, observers_of


def on_a_simulated_clock(
    geometry, controller, boom, *, stream, seconds, rate_hz, limits, log, axes=None, observers=None,
    **listeners
):  # fmt: skip
    """Drive as `hopdata.steering.live.drive.drive` does, without waiting."""

    def decided(decision):
        log.decision(decision)
        listeners["on_decision"](decision)

    drive = ClockedDrive(
        stream.source,
        observers or observers_of(geometry, rate_hz),
        controller,
        boom,
        axes=axes,
        limits=limits,
        checks=checks_of(geometry, rate_hz, limits),
        on_decision=decided,
        on_frames=log.frames,
    )

    def is_over():
        listeners["on_look"](drive.loop, stream)
        return drive.loop.state == "stopped"

    log.start(lambda: log.events((), drive.loop.watch))
    drive.run(seconds, ended=is_over)
    drive.loop.end(Message("steering.the_end"))
    log.close(drive.now_s, {})
    rests = drive.loop.watch.rests
    return SimpleNamespace(decisions=drive.loop.decisions(), rests=rests)
