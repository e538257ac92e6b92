from .learners import Learners as Learners
from .settings import OnlineLearning as OnlineLearning
