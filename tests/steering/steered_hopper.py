"""A simulated hopper whose boom swings, with its true pose, boom angle and stances."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.recordings.recording import Recording
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.capture import observe
from hopdata.synthesis.floor import CurvedFloor
from hopdata.synthesis.gaps import draw_gaps
from hopdata.synthesis.markers import MarkerTracks, track_markers
from hopdata.synthesis.options import GapOptions, Kicks, MarkerOptions, Operator
from hopdata.synthesis.trial import Trial, run_trial
