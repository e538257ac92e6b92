"""The machine's part in a job: packages and GPUs, which may be missing."""

from collections.abc import Collection
from importlib.util import find_spec

from affmap.config.root import Config
from affmap.pipeline.stage import CONTROL, TRAIN, StageDefinition, policy_of
from affmap.rivals.settings import Reinforcement
from affmap.settings import missing
from hydra_plugins.hyperopt_sweeper import FinalError


class MachineError(FinalError):
    """A lack of this machine, of something that a job needs; the message names it and a remedy.

    No ConfigError, since the values are right: a search, which counts those as failures of a trial, ends.
    """


def check_logger(config: Config) -> None:
    """Make sure that the logger of trainings is installed.

    Raises:
        MachineError: it is not.
    """
    if config.logger != "csv" and not find_spec(config.logger):
        raise MachineError(f"{missing(f'logger = {config.logger!r}', config.logger)}, or say logger=csv.")


def check_rival(config: Config, planned: Collection[StageDefinition]) -> None:
    """Make sure that the library of a rival's training is installed, if that is one of the planned stages.

    Raises:
        MachineError: it is not.
    """
    if isinstance(config.rival, Reinforcement) and policy_of(config) in planned and not find_spec("stable_baselines3"):
        raise MachineError(f"{missing(f'rival = {config.rival.kind!r}', 'rl')}, or leave it out of the sweep.")


def check_devices(config: Config, planned: Collection[StageDefinition]) -> None:
    """Make sure that this machine has the devices of stages; imports torch only if one needs a GPU.

    Raises:
        MachineError: PyTorch finds no such GPU.
    """
    kind, _, index = config.control.device.partition(":")
    trains_on_gpu = TRAIN in planned and config.training.accelerator == "gpu"
    flies_on_gpu = CONTROL in planned and kind == "cuda"
    if not trains_on_gpu and not flies_on_gpu:
        return
    import torch

    count = torch.cuda.device_count()
    if trains_on_gpu and not torch.cuda.is_available() and not torch.backends.mps.is_available():
        raise MachineError("training.accelerator = 'gpu': PyTorch finds no GPU here; say training.accelerator=cpu.")
    if flies_on_gpu and int(index or 0) >= count:
        there = f"only {count} (from cuda:0)" if count else "no CUDA GPU"
        raise MachineError(
            f"control.device = {config.control.device!r}: PyTorch finds {there} here; say control.device=cpu."
        )
