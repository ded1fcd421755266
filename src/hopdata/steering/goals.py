"""Goals and bounds that experiments, planner, environment and drives share."""

import numpy as np

#: Distance from a point within which a robot has arrived there.
#: Unit: m. Origin: table: the goal region of the dissertation's experiments.
ARRIVED_M = 0.11
#: Error of the heading within which a robot has turned to it.
#: Unit: rad. Origin: table: the goal region of the dissertation's experiments.
TURNED_RAD = np.pi / 12
#: Strides within which a goal must be reached.
#: Unit: 1. Origin: table: the dissertation's experiments.
MOST_STRIDES = 50
#: Distance from the origin beyond which a robot has left the floor of the lab.
#: Unit: m. Origin: chosen.
FENCE_M = 3.0
#: Largest swing of the hopper's boom in a hop.
#: Unit: rad. Origin: table: three of the sixteen angles of the dissertation's grid.
SWING_LIMIT_RAD = 3 * np.pi / 8
