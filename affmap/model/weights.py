"""The weights of a stack as files: safetensors, so that reading a stranger's file executes nothing."""

from pathlib import Path

from safetensors.torch import load_file, save_file

from affmap.model.stack import Stack
from affmap.reading import reading

WEIGHTS = "weights.safetensors"

SNAPSHOT = "weights-epoch-{epoch}.safetensors"
"""Weights kept during training."""


def save(stack: Stack, path: Path) -> None:
    """Write the weights of a stack, `[M, ...]` each."""
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in stack.state_dict().items()}, path)


def restore(stack: Stack, path: Path) -> Stack:
    """Give a stack the weights at `path`.

    Raises:
        ConfigError: the file is not what it should be, or holds the weights of another stack.
    """
    with reading(path):
        stack.load_state_dict(load_file(path))
    return stack.eval()
