"""Rough memory bounds, to reject impossible settings up front.

Only the largest arrays count, so a job may need a few times as much. Knows nothing of the machine: jobs are checked
where they are submitted, and may run elsewhere.
"""

import math
from collections.abc import Iterator, Sequence
from operator import attrgetter
from typing import NamedTuple

from affmap.config.root import Config
from affmap.env.geometry import STEP
from affmap.env.layout import Layout
from affmap.model.settings import ModelSettings
from affmap.planning.cem import CEMPlanner
from affmap.settings.messages import ConfigError, format_value
from affmap.view import PIXELS

LIMIT_GIB = 256
"""More than this must be a mistake: the largest job of the paper needs less than one."""


class Demand(NamedTuple):
    """An array, or several, that a job holds in memory."""

    name: str
    keys: Sequence[str]
    """The keys that its size follows from."""
    numbers: float
    """Its size, numbers of 4 bytes."""

    @property
    def gib(self) -> float:
        """Its size in GiB."""
        return 4 * self.numbers / 2**30


def check(config: Config, origin: str = "the configuration") -> None:
    """Reject a job that no machine could run.

    Args:
        config: of the job.
        origin: where its values come from, for the error.

    Raises:
        ConfigError: an array would be larger than `LIMIT_GIB`; the message names the keys that its size follows from.
    """
    for demand in demands(config):
        if demand.gib > LIMIT_GIB:
            values = [f"{key} = {format_value(attrgetter(key)(config))}" for key in demand.keys]
            raise ConfigError(
                f"{origin}: {', '.join(values)}: {demand.name} would take {demand.gib:.2g} GiB of memory at "
                "once; make something smaller."
            )


def demands(config: Config) -> Iterator[Demand]:
    """The largest arrays that a job holds in memory."""
    members, model, planner, control = config.members, config.model, config.planner, config.control
    yield _data_set(config)
    yield from _training(config)
    agents = members * control.runs_per_member
    # The actions of all candidates and their copies, and one step of all of them in the models.
    search = 8 * planner.horizon + model.context_size + _units(model)
    keys = ["members", "control.runs_per_member", "planner.horizon", "model.context_size", "model.hidden_size"]
    if isinstance(planner, CEMPlanner):
        search *= planner.num_candidates + planner.num_kept
        keys.append("planner.num_candidates")
    yield Demand("planning", keys, agents * search)
    keys = ["members", "control.runs_per_member", "control.num_steps", "planner.horizon"]
    yield Demand("the records of control", keys, agents * control.num_steps * (4 * planner.horizon + 10))
    codes, codes_keys = members * model.context_size, ("members", "model.context_size")
    nodes = _nodes(config.map_layout.size, config.report.map_spacing)
    yield Demand("maps of the report", (*codes_keys, "report.map_spacing", "map_layout.size"), 2 * codes * nodes)
    if config.lookup.spacing:
        layouts = 1 if isinstance(config.control_layout, Layout) else control.runs_per_member
        nodes = _nodes(config.control_layout.size, config.lookup.spacing)
        yield Demand("affordance maps", (*codes_keys, "lookup.spacing", "control_layout.size"), codes * layouts * nodes)
    # The grid on which reachable places are found.
    yield Demand("the arena", ("control_layout.size",), 6 * math.prod(config.control_layout.size) / STEP**2)


def _data_set(config: Config) -> Demand:
    """The recorded steps: bits of the views as bytes, and a dozen numbers; once as made and once as collected."""
    data = config.data
    steps = len(config.training_layouts) * data.num_sequences * data.num_steps
    numbers = 2 * steps * (len(config.channels) * PIXELS**2 / 4 + 12)
    return Demand("the data set", ("data.num_sequences", "data.num_steps"), numbers)


def _training(config: Config) -> Iterator[Demand]:
    model, training = config.model, config.training
    members = config.members * (training.num_trials or 1)
    # With gradients and Adam's two moments.
    inputs = model.context_size + 10 + (model.hidden_size if _is_recurrent(model) else 0)
    weights = 4 * members * (inputs * _units(model) + 32 * model.context_size)
    yield Demand("the models", ("members", "model.context_size", "model.hidden_size"), weights)
    batch = training.batch_size * min(training.chunk_length, config.data.num_steps)
    keys = ("members", "training.batch_size", "training.chunk_length", "model.context_size", "model.hidden_size")
    yield Demand("a batch", keys, 2 * members * batch * (model.context_size + _units(model)))
    yield Demand("the losses", ("members", "training.num_epochs"), 2 * members * training.num_epochs)


def _is_recurrent(model: ModelSettings) -> bool:
    return model.transition.kind == "gru"


def _units(model: ModelSettings) -> int:
    """The numbers that a step of the transition model computes: each of a GRU's r, z and n has its hidden units."""
    return (3 if _is_recurrent(model) else 1) * model.hidden_size


def _nodes(size: tuple[float, float], spacing: float) -> float:
    """Number of nodes of a map."""
    return math.prod(side / spacing + 1 for side in size)
