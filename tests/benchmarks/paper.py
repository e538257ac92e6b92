"""The work of the whole paper, counted from its configuration: updates of trainings and steps of flights.

Stages that jobs share are counted once. Knows no clock.
"""

from collections.abc import Iterable, Sequence
from math import ceil

from affmap.config.root import Config
from affmap.config.sweep import Sweep
from affmap.experiments import ROOMS
from affmap.pipeline.stage import CONTROL, StageDefinition
from affmap.pipeline.train import TRAIN


def jobs(overrides: Sequence[str] = (), experiments: Iterable[str] = ROOMS) -> list[Config]:
    """All jobs of the paper's experiments, those of growing maps included, with `overrides` of their configurations."""
    every = [Sweep.read([f"experiment={name}", *overrides]) for name in experiments]
    sweeps = [sweep for sweep in every if sweep.first.report.paper_figures]
    growing = [growth for sweep in sweeps if (growth := sweep.growth())]
    return [config for sweep in (*sweeps, *growing) for config in sweep.configs]


def trainings(configs: Iterable[Config]) -> list[Config]:
    """One job for each training."""
    return _distinct(TRAIN, configs)


def flights(configs: Iterable[Config]) -> list[Config]:
    """One job for each set of runs."""
    return _distinct(CONTROL, configs)


def updates(config: Config) -> int:
    """Updates of a job's training: the chunks of all batches of sequences, in all epochs."""
    data, training = config.data, config.training
    sequences = len(config.training_layouts) * (data.num_sequences - data.num_validation)
    return training.num_epochs * ceil(sequences / training.batch_size) * ceil(data.num_steps / training.chunk_length)


def _distinct(stage: StageDefinition, configs: Iterable[Config]) -> list[Config]:
    return list({stage.of(config).digest: config for config in configs}.values())
