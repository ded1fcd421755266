from pkgutil import resolve_name

from hopdata.products import installed
from hopdata.steering.live.sources import SOURCES, stream_of
from hopdata.steering.live.stream import MarkerStream


def test_the_command_offers_every_source():
    steering = next(one for one in installed() if one.name == "steering")
    options = steering.commands()["drive"]["options"]
    (source,) = [one for one in options if one["flags"] == ["--source"]]
    assert source["choices"] == list(SOURCES)
    assert source["default"] == "qualisys"


def test_every_source_is_a_stream_with_the_same_checks():
    hosts = {"qualisys": "10.0.0.2", "motioncapture": "vicon:10.0.0.2", "lsl": "lab"}
    for name, kind in SOURCES.items():
        made = stream_of(name, ["a.o"], host=hosts[name], port=1, rate_hz=100.0)
        assert type(made) is resolve_name(kind)
        assert isinstance(made, MarkerStream)
        assert (made.host, made.labels, made.rate_hz) == (hosts[name], ("a.o",), 100.0)
