from .cem import CEMPlanner as CEMPlanner
from .gradient import GradientPlanner as GradientPlanner
from .objective import expected_free_energy as expected_free_energy
from .planner import Plan as Plan
from .planner import Planner as Planner
from .registry import register_planner as register_planner
