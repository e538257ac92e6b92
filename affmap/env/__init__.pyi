from .body import Vehicle as Vehicle
from .layout import Circle as Circle
from .layout import Layout as Layout
from .procedural import Procedural as Procedural
from .registration import register as register
from .rules import Rules as Rules
from .vehicle import VehicleEnv as VehicleEnv
from .walls import Walls as Walls
