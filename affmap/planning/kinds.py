"""The planners that a configuration can name: whoever adds one adds it here."""

from typing import Annotated

from pydantic import Field

from affmap.planning.cem import CEMPlanner
from affmap.planning.gradient import GradientPlanner

AnyPlanner = Annotated[CEMPlanner | GradientPlanner, Field(discriminator="kind")]
"""A file of `conf/planner`; its `kind` tells which."""
