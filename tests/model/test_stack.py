"""A stack: its members are what they would be alone, and what they were when this test was written."""

import hashlib

import pytest
import torch

from affmap.model.stack import ModelSettings, Stack, num_changes


def stack(context_size: int, seeds: list[int], channels: int = 1) -> Stack:
    return Stack(ModelSettings.load("model", "default", context_size=context_size), channels, seeds)


@pytest.mark.parametrize("context_size", [0, 1, 8, 32])
def test_a_member_of_a_stack_is_the_member_alone(context_size: int) -> None:
    """Seeds 3 and 7 together against 7 alone, bit by bit."""
    together, alone = stack(context_size, [3, 7]).state_dict(), stack(context_size, [7]).state_dict()
    assert together.keys() == alone.keys()
    for name, parameter in alone.items():
        assert torch.equal(together[name][1:], parameter), name
        assert not torch.equal(together[name][:1], parameter), name


@pytest.mark.parametrize("context_size", [0, 8])
def test_selected_members_are_those_alone(context_size: int) -> None:
    """Against stacks of the selected seeds, in the order asked for; a copy, which leaves the whole as it was."""
    whole = stack(context_size, [3, 7, 9])
    chosen = whole.select([2, 0])
    assert chosen.seeds == (9, 3)
    for name, parameter in stack(context_size, [9, 3]).state_dict().items():
        assert torch.equal(chosen.state_dict()[name], parameter), name
    with torch.no_grad():
        chosen.transition.output_bias.zero_()
    assert whole.transition.output_bias.all()


def test_joined_stacks_are_one_stack_of_all_members() -> None:
    """Against a stack of all seeds; a copy, which leaves the parts as they were."""
    parts = [stack(3, [4, 0]), stack(3, [9])]
    whole, expected = Stack.joined(parts), stack(3, [4, 0, 9])
    assert whole.seeds == (4, 0, 9)
    assert all(torch.equal(weight, expected.state_dict()[name]) for name, weight in whole.state_dict().items())
    for parameter in whole.parameters():
        parameter.data.zero_()
    assert all(weight.any() for part in parts for weight in part.parameters())


def test_initial_weights_are_those_of_2026() -> None:
    """Stored in 2026-11: SHA-256 of all initial weights of seed 0 in the order of their names, and the first ones.

    A random number is made from 24 random bits, and scaled by one rounded division: the same on every machine.
    """
    weights = stack(8, [0]).state_dict()
    text = b"".join(name.encode() + weights[name].numpy().tobytes() for name in sorted(weights))
    assert sum(weight.numel() for weight in weights.values()) == 324 + 32 * 8 + 828 + 36 + 17 * 8
    assert [round(number, 6) for number in weights["transition.hidden_weight"].flatten()[:3].tolist()] == GOLDEN_FIRST
    assert hashlib.sha256(text).hexdigest()[:16] == GOLDEN_DIGEST


def test_the_global_generator_is_neither_used_nor_moved() -> None:
    """Torch's global state is the same before and after, and the weights do not depend on it."""
    torch.manual_seed(1)
    before = torch.get_rng_state()
    first = stack(3, [0]).state_dict()
    assert torch.equal(torch.get_rng_state(), before)
    torch.manual_seed(2)
    for name, parameter in stack(3, [0]).state_dict().items():
        assert torch.equal(first[name], parameter)


def test_a_state_holds_weights_only() -> None:
    """Every tensor has the members first; constants are not stored."""
    for name, tensor in stack(5, [0, 1, 2]).state_dict().items():
        assert tensor.shape[0] == 3 and name.endswith(("weight", "bias")), name


GOLDEN_FIRST = [-0.11834, 0.030316, -0.223626]
GOLDEN_DIGEST = "1da28a61e4873be4"


def test_changes_of_weights_are_counted() -> None:
    """PyTorch's own count; where it does not count, in inference mode, no error."""
    weights = [torch.zeros(2), torch.zeros(3)]
    before = num_changes(weights)
    weights[1].add_(1)
    assert num_changes(weights) == before + 1
    with torch.inference_mode():
        assert num_changes([torch.zeros(2)]) == 0
