"""What is said on stderr while code is compiled."""

import time

import pytest

from hopdata.hybrid.compiled import aloud


def test_what_takes_long_is_said_and_what_does_not_is_not(monkeypatch, capsys):
    monkeypatch.setattr(aloud, "SILENT_S", 0.05)
    with aloud.said_if_long("the functions of a test"):
        time.sleep(0.2)
    told = capsys.readouterr().err.splitlines()
    assert told == [
        "hopdata: compiling the functions of a test; later processes load them",
        "hopdata: compiled in 0 s",
    ]
    monkeypatch.setattr(aloud, "SILENT_S", 60.0)
    with aloud.said_if_long("the functions of a test"):
        pass
    with pytest.raises(ValueError), aloud.said_if_long("what fails"):
        raise ValueError
    assert capsys.readouterr().err == ""
