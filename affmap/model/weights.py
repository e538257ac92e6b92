"""The weights of a stack as files: safetensors, so that reading a stranger's file executes nothing."""

from pathlib import Path

from safetensors.torch import load_file, save_file

from affmap.model.stack import Stack

WEIGHTS = "weights.safetensors"

SNAPSHOT = "weights-epoch-{epoch}.safetensors"
"""Weights kept during training."""


def save(stack: Stack, path: Path) -> None:
    """Write the weights of a stack, `[M, ...]` each."""
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in stack.state_dict().items()}, path)


def restore(stack: Stack, path: Path) -> Stack:
    """Give a stack the weights at `path`."""
    stack.load_state_dict(load_file(path))
    return stack.eval()
