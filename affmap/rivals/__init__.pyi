from .policy import Network as Network
from .policy import Policy as Policy
from .settings import PPO as PPO
from .settings import SAC as SAC
from .settings import TD3BC as TD3BC
from .settings import Cloning as Cloning
from .settings import Distillation as Distillation
