from .policy import Network as Network
from .policy import Policy as Policy
from .settings import Cloning as Cloning
from .settings import Distillation as Distillation
from .settings import Reinforcement as Reinforcement
