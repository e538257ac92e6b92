"""The stages of a job: the configuration keys that their results depend on, and the versions of their rules.

A stage's configuration is exactly the part of the whole that its result depends on: experiments that agree on it share
the result. Fields of settings with `exclude=True` change no result and do not count. The work of each stage has a file
of its own.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from affmap.config.root import Config
from affmap.rivals.settings import Rival, Source
from affmap.store.stage import Stage


@dataclass(frozen=True)
class StageDefinition:
    """A kind of stage. Raise `version` when its numbers change: stages of the old rules are then made anew."""

    name: str
    keys: tuple[str, ...]
    """Keys of the configuration that it depends on, besides those of the stages that it needs."""
    needs: "StageDefinition | None" = None
    """The stage whose result it starts from."""
    version: int = 1

    def of(self, config: Config) -> Stage:
        """The stage of a job: its name, its part of the configuration, and versions of rules above 1."""
        return Stage(self.name, config.part(self.all_keys), self._versions)

    @cached_property
    def all_keys(self) -> tuple[str, ...]:
        """Keys of the configuration that it and the stages before it depend on, in the order of the configuration."""
        keys = {key for each in self._chain() for key in each.keys}
        return tuple(key for key in Config.model_fields if key in keys)

    @cached_property
    def _versions(self) -> dict[str, int]:
        return {each.name: each.version for each in self._chain() if each.version > 1}

    def _chain(self) -> Iterator["StageDefinition"]:
        if self.needs:
            yield from self.needs._chain()
        yield self


DATA = StageDefinition("data", ("training_layouts", "vehicle", "data"))
TRAIN = StageDefinition("train", ("model", "training", "learning", "seed", "members"), needs=DATA, version=2)
PREDICT = StageDefinition("predict", ("models", "report", "map_layout"), needs=TRAIN)
MAP = StageDefinition("map", ("models", "report", "map_layout"), needs=TRAIN)
BLOCKS = StageDefinition("blocks", ("models", "report", "map_layout"), needs=TRAIN)
"""Only of models whose codes have blocks."""
CONTROL = StageDefinition(
    "control",
    ("models", "lookup", "memory", "planner", "agent", "control", "control_layout", "variation"),
    needs=TRAIN,
    version=2,
)

POLICIES: dict[Source, StageDefinition] = {
    "data": StageDefinition("policy", ("rival", "rival_share", "seed", "members"), needs=DATA),
    "plans": StageDefinition("policy", ("rival", "rival_share", "lookup", "planner", "control"), needs=TRAIN),
    "worlds": StageDefinition("policy", ("rival", "rival_share", "training_layouts", "vehicle", "seed", "members")),
}
"""Only of rivals; they depend on the source of a policy alone."""


def policy_of(config: Config) -> StageDefinition | None:
    """The stage that trains the policy of a rival."""
    return POLICIES[config.rival.source] if isinstance(config.rival, Rival) else None


def control_of(config: Config) -> StageDefinition:
    """The stage of control; of a rival, it starts from the policy."""
    policy = policy_of(config)
    return replace(CONTROL, keys=(*CONTROL.all_keys, "rival"), needs=policy) if policy else CONTROL


def stages_of(config: Config) -> tuple[StageDefinition, ...]:
    """The kinds of stages that a job has, in order."""
    has_blocks = config.model.code.in_blocks and config.model.context_size > 0
    policy = policy_of(config)
    blocks, policies = ((BLOCKS,) if has_blocks else ()), ((policy,) if policy else ())
    return (DATA, TRAIN, PREDICT, MAP, *blocks, *policies, control_of(config))
