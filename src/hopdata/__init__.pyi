from hopdata.analysis import Study as Study
from hopdata.analysis import analyse as analyse
from hopdata.analysis import plan as plan
from hopdata.analysis import study as study
from hopdata.analysis import synthesize as synthesize
from hopdata.contact_times import contacts as contacts
from hopdata.errors import HopdataError as HopdataError
from hopdata.hybrid import System as System
from hopdata.hybrid import solve as solve
from hopdata.inspecting.inspected import inspect as inspect
from hopdata.maps.verdict import judge as judge
from hopdata.reading import guess as guess
from hopdata.reading import read as read
from hopdata.recording import Recording as Recording
from hopdata.saved import load as load

__version__: str
