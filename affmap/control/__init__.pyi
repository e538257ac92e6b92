from .agent import Agent as Agent
from .agent import ControlSettings as ControlSettings
from .agent import Decision as Decision
from .agent import Observation as Observation
from .episodes import Runs as Runs
from .episodes import fly as fly
from .pilot import Pilot as Pilot
from .pretrained import load as load
