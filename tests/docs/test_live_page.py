"""The example on the page about live streams runs, for a shorter time."""

import re
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs/live.md"


def test_the_simulated_robot_is_driven(capsys):
    with_a_robot, without = re.findall(
        r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL
    )
    compile(with_a_robot, str(PAGE), "exec")
    assert "seconds=8.0" in without
    exec(compile(without.replace("seconds=8.0", "seconds=2.0"), str(PAGE), "exec"), {})
    assert re.search(r"\d s  planned", capsys.readouterr().out)
