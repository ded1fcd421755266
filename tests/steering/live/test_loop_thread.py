import asyncio
import threading

from loopback import LONG_S, our_threads, wait_until

from hopdata.steering.live.loop_thread import LoopThread


async def forever():
    await asyncio.Event().wait()


def test_it_runs_until_it_is_stopped():
    thread, called = LoopThread("hopdata-test", forever), threading.Event()
    thread.start()
    thread.call(called.set)
    assert called.wait(LONG_S)
    assert thread.alive
    thread.stop()
    thread.stop()
    thread.call(called.set)  # ignored
    assert not thread.alive
    assert thread.failure is None
    assert our_threads() == []


def test_a_failure_is_kept():
    async def fails():
        raise RuntimeError("broken")

    thread = LoopThread("hopdata-test", fails)
    thread.start()
    wait_until(lambda: not thread.alive)
    assert str(thread.failure) == "broken"
    thread.stop()
