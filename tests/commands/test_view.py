"""``hopdata view``: the page on which a user can rotate a recording."""

import json
import re

from hopdata.__main__ import main


def test_the_page_holds_the_recording_and_no_other_file_is_asked_for(
    sample_path, tmp_path, capsys, monkeypatch
):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    page = tmp_path / "page.html"
    assert main(["view", str(sample_path), "-o", str(page)]) == 0
    assert opened == [page.as_uri()]
    assert str(page) in capsys.readouterr().out
    text = page.read_text()
    assert len(text) < 1_000_000
    assert not re.search(r"https?://|src=|url\(", text)
    parts = json.loads(re.search(r'application/json">(.*?)</script>', text)[1])["parts"]
    roles = dict(zip(parts[0]["markers"], parts[0]["roles"], strict=True))
    assert roles["foot2"] == "foot"
    assert roles["body1"] == "body"
    assert len(parts) == 5


def test_a_file_that_is_not_there_is_told(capsys):
    assert main(["view", "nothing.c3d", "--no-browser"]) == 1
    assert "nothing.c3d: expected a file, found none" in capsys.readouterr().err
