from . import collect as collect
from .batches import DataModule as DataModule
from .settings import Exploration as Exploration
