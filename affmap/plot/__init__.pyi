from .arena import affordance_map as affordance_map
from .arena import layout as layout
from .arena import plan as plan
from .arena import time_to_go as time_to_go
from .arena import trajectories as trajectories
from .numbers import bars as bars
from .numbers import boxes as boxes
from .numbers import losses as losses
