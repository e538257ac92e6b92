from .root import Config as Config
from .search import Search as Search
from .sweep import Sweep as Sweep
