"""Names of this room, imported when they are first asked for: `lazy_loader` reads this file."""

from .controller import Controller as Controller
from .controller import Decision as Decision
from .controller import Observation as Observation
from .controller import Status as Status
from .errors import ControllerError as ControllerError
from .errors import InputError as InputError
from .errors import StationError as StationError
from .geometry import Valve as Valve
from .limits import Limit as Limit
from .metrics import Metrics as Metrics
from .parameters import Station as Station
from .preset_files import load_station as load_station
from .preset_files import presets as presets
from .record import Record as Record
from .scenario import Scenario as Scenario
from .scenario import parse_scenario as parse_scenario
from .scenario_files import load_scenario as load_scenario
from .scenario_files import scenarios as scenarios
from .simulation import simulate as simulate
