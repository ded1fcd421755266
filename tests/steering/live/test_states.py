import threading

from loopback import LONG_S

from hopdata.steering.live.states import StatusLog


def test_states_are_kept_in_order_with_their_reasons():
    log = StatusLog()
    log.report("connecting")
    log.report("lost", "gone")
    assert [s.state for s in log.history()] == ["idle", "connecting", "lost"]
    assert log.status.message == "gone"
    times = [s.at_s for s in log.history()]
    assert times == sorted(times)


def test_waiting_for_a_state():
    log = StatusLog()
    threading.Timer(0.02, log.report, ("streaming",)).start()
    assert log.wait_for("streaming", "failed", timeout_s=LONG_S).state == "streaming"
    assert log.wait_for("lost", timeout_s=0.01) is None
