from .learners import Learners as Learners
from .settings import GoalLearning as GoalLearning
from .settings import OfflineLearning as OfflineLearning
from .settings import RandomLearning as RandomLearning
from .settings import SeekingLearning as SeekingLearning
