from .batches import DataModule as DataModule
from .collect import Exploration as Exploration
