"""Draw the robot and the live loop for the documents, from the scene and the code.

    python packaging/drawings.py     writes docs/robot.svg and docs/live_loop.svg

A test compares the words in them with what would be drawn now.
"""

from dataclasses import asdict
from pathlib import Path

from matplotlib.figure import Figure

from hopdata.arrays import pd
from hopdata.figures.robot import robot_figure
from hopdata.figures.style import save_figure
from hopdata.steering.figures.drawings import loop_figure
from hopdata.steering.live.parts import FLOWS, PARTS
from hopdata.steering.robot import SteeredHopper
from hopdata.synthesis.sketch import hopper_sketch, leg_forces

DOCS = Path(__file__).parents[1] / "docs"


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
    }


if __name__ == "__main__":
    for name, figure in drawn().items():
        save_figure(figure, DOCS / name, formats=["svg"])
