from .module import TrainingModule as TrainingModule
from .settings import TrainingSettings as TrainingSettings
