from hopdata.analysis import Study as Study
from hopdata.analysis import analyse as analyse
from hopdata.analysis import read as read
from hopdata.errors import HopdataError as HopdataError
from hopdata.hybrid import System as System
from hopdata.hybrid import solve as solve
from hopdata.maps.verdict import judge as judge
from hopdata.recording import Recording as Recording
from hopdata.synthesis import simulate_recording as simulate_recording

__version__: str
