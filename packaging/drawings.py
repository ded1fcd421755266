"""Draw pictures of the documents: the robot, the live loop, and the sample's answer.

    python packaging/drawings.py                   writes them to docs
    python packaging/drawings.py results/sample    takes this study's answer first

What is drawn of the answer is in docs/answer.json. A test compares the words of the
pictures with what would be drawn now, and the sample with the one that was answered.
"""

import hashlib
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from hopdata.arrays import pd
from hopdata.figures.robot import robot_figure
from hopdata.figures.style import save_figure
from hopdata.figures.verdict import verdict_figure
from hopdata.steering.figures.drawings import loop_figure
from hopdata.steering.live.parts import FLOWS, PARTS
from hopdata.steering.robot import SteeredHopper
from hopdata.synthesis.sketch import hopper_sketch, leg_forces

CHECKOUT = Path(__file__).parents[1]
DOCS = CHECKOUT / "docs"
SAMPLE = CHECKOUT / "data" / "sample" / "hopper.h5"
ANSWER = DOCS / "answer.json"
# What the picture of the answer shows of verdict.json.
SHOWN = (
    "conclusion",
    "sentence",
    "decided_by",
    "effect",
    "holds_from",
    "confidence",
    "margin",
    "power",
)


def digest_of_sample() -> str:
    """Return the SHA-256 of the bundled sample."""
    return hashlib.sha256(SAMPLE.read_bytes()).hexdigest()


def answer_of(study: Path) -> dict[str, Any]:
    """Return what is drawn of the answer of a study of the bundled sample."""
    verdict = json.loads((study / "verdict.json").read_text("utf-8"))
    touchdowns = pd.read_csv(study / "tables" / "touchdowns.csv")
    used = touchdowns[~touchdowns["excluded"]]
    return {
        "sample_sha256": digest_of_sample(),
        "verdict": {name: verdict[name] for name in SHOWN},
        "landings": used["schedule"].value_counts().to_dict(),
        "feet": ["foot1", "foot2", "foot3"],
    }


def answer_figure(answer: Mapping[str, Any]) -> Figure:
    """Draw the answer in docs/answer.json."""
    landings = answer["landings"]
    orders = [order for order, count in landings.items() for _ in range(count)]
    touchdowns = pd.DataFrame({"schedule": orders, "excluded": False})
    touchdowns[[f"contact_{foot}_s" for foot in answer["feet"]]] = 0.0
    return verdict_figure(answer["verdict"], touchdowns)


def drawn() -> dict[str, Figure]:
    """Return the drawings by their names."""
    robot = SteeredHopper()
    limit = robot.swing_limit_rad
    sketch = hopper_sketch(robot.hopper, robot.markers, swing_limit_rad=limit)
    parts = pd.DataFrame([asdict(part) for part in PARTS])
    flows = pd.DataFrame([asdict(flow) for flow in FLOWS])
    return {
        "robot": robot_figure(sketch, leg_forces(robot.hopper)),
        "live_loop": loop_figure(parts, flows),
        "answer": answer_figure(json.loads(ANSWER.read_text("utf-8"))),
    }


if __name__ == "__main__":
    for study in sys.argv[1:]:
        content = json.dumps(answer_of(Path(study)), indent=1)
        ANSWER.write_text(content + "\n", encoding="utf-8")
    for name, figure in drawn().items():
        save_figure(figure, DOCS / name, formats=["svg"])
