"""Losses, clipping and optimiser of a stack: each member is what it would be alone in plain PyTorch."""

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.distributions import Normal

from affmap.data.batches import Batch
from affmap.model.registry import EffectsSettings, GRUSettings, MLPSettings, TransitionSettings
from affmap.model.stack import ModelSettings, Stack
from affmap.model.windows import Windows, take_apart
from affmap.results.files import EVERYWHERE
from affmap.training.composition import composition_gap, total_correlation
from affmap.training.module import TrainingModule, clip_per_member, cooldown
from affmap.training.settings import TrainingSettings
from affmap.training.steps import step_losses, summarise


def module(
    context_size: int = 3,
    seeds: tuple[int, ...] = (0, 1, 2),
    transition: TransitionSettings = MLPSettings(kind="mlp"),  # noqa: B008
    **changes: Any,
) -> TrainingModule:
    stack = Stack(ModelSettings.load("model", "default", context_size=context_size, transition=transition), 1, seeds)
    return TrainingModule(stack, TrainingSettings.load("training", "default", **changes))


def batch(is_first: bool = True, seed: int = 0) -> Batch:
    """Four sequences of six steps."""
    generator = torch.Generator().manual_seed(seed)
    views = torch.rand(1, 4, 6, 1, 11, 11, generator=generator) < 0.3
    delta, target = (0.1 * torch.randn(1, 4, 6, 2, generator=generator) for _ in range(2))
    return Batch(take_apart(views), delta, torch.rand(1, 4, 6, 4, generator=generator), target, is_first)


@pytest.mark.parametrize("context_size", [0, 3])
def test_the_loss_is_the_mean_over_the_batch_of_the_sum_over_coordinates(context_size: int) -> None:
    """`torch.distributions`."""
    trained, data = module(context_size), batch()
    _, prediction = trained.stack.transition.unroll((), trained.stack.encode(data.views), data.delta, data.action)
    density = Normal(prediction.mean, prediction.log_std.exp()).log_prob(data.target)  # [M, B, T, 2]
    expected = -density.sum(-1).mean((1, 2))
    torch.testing.assert_close(trained.loss(data), expected)


@pytest.mark.usefixtures("loops")
@pytest.mark.parametrize("transition", [MLPSettings(kind="mlp"), GRUSettings(kind="gru")], ids=["MLP", "GRU"])
@pytest.mark.parametrize("context_size", [0, 3])
def test_a_validation_loss_is_the_mean_over_all_steps_not_over_batches_or_chunks(
    context_size: int, transition: TransitionSettings
) -> None:
    """`torch.distributions` over whole sequences: batches of four and of one, whose losses are far apart, in chunks of
    five steps and of two. Losses by kinds of steps have the same mean."""
    trained = module(context_size, transition=transition)
    generator = torch.Generator().manual_seed(0)
    views = torch.rand(1, 5, 7, 1, 11, 11, generator=generator) < 0.3
    delta, target = (0.1 * torch.randn(1, 5, 7, 2, generator=generator) for _ in range(2))
    action = torch.rand(1, 5, 7, 4, generator=generator)
    target[:, 4] *= 20
    target[:, :, 5:] *= 5

    def cut(sequences: slice, steps: slice) -> Batch:
        key = slice(None), sequences, steps
        return Batch(take_apart(views[key]), delta[key], action[key], target[key], is_first=steps.start == 0)

    batches = [[cut(some, steps) for steps in (slice(0, 5), slice(5, 7))] for some in (slice(0, 4), slice(4, 5))]
    trained.on_validation_epoch_start()
    with torch.no_grad():
        for number, batch in enumerate(batches):
            trained.validation_step(batch, number)
        trained.on_validation_epoch_end()
        model, code = trained.stack.transition, trained.stack.encode(take_apart(views))
        _, (mean, log_std) = model.unroll(model.initial(5), code, delta, action)
    losses = -Normal(mean, log_std.exp()).log_prob(target).sum(-1)  # [M, B, T]
    expected = losses.mean((1, 2))
    chunks = [part.mean((1, 2)) for part in losses.split([5, 2], dim=2)]
    halves = [part.mean((1, 2)) for part in losses.split([4, 1], dim=1)]
    assert all((sum(each) / 2 - expected).abs().min() > 1 for each in (chunks, halves))
    torch.testing.assert_close(trained.validation_nll[0], expected, rtol=1e-4, atol=1e-4)
    by_step = step_losses(trained.stack, batches)
    torch.testing.assert_close(by_step, losses, rtol=1e-4, atol=1e-4)
    table = summarise(by_step, np.zeros((5, 7), int), ["original"] * 5, (0, 1, 2))
    np.testing.assert_allclose(table.loc[table["world"] == EVERYWHERE, "mean"], expected, rtol=1e-4)


def test_gradients_of_a_member_are_those_of_the_member_alone() -> None:
    """A stack of one with the same seed."""
    together = module(3, (5, 6, 7))
    together.loss(batch()).sum().backward()
    for member, seed in enumerate((5, 6, 7)):
        alone = module(3, (seed,))
        alone.loss(batch()).sum().backward()
        for (name, mine), its in zip(together.named_parameters(), alone.parameters(), strict=True):
            assert mine.grad is not None and its.grad is not None and its.grad.abs().max() > 0
            torch.testing.assert_close(mine.grad[member], its.grad[0], rtol=1e-4, atol=1e-6, msg=name)


def gradients(seed: int) -> list[Tensor]:
    """Of three members, of very different size."""
    generator = torch.Generator().manual_seed(seed)
    size = torch.tensor([1e-3, 0.3, 50.0])
    shapes = [(3, 4, 5), (3, 7), (3, 2, 3, 3, 3)]
    return [torch.randn(*s, generator=generator) * size.view(-1, *[1] * (len(s) - 1)) for s in shapes]


@pytest.mark.parametrize("max_norm", [0.1, 1.2, 2.0])
def test_clipping_is_torch_s_for_each_member(max_norm: float) -> None:
    """`torch.nn.utils.clip_grad_norm_` on each member's gradients alone; some of them are not clipped."""
    clipped = gradients(0)
    clip_per_member(clipped, max_norm)
    norms = []
    for member in range(3):
        alone = [torch.nn.Parameter(torch.zeros_like(gradient[member])) for gradient in clipped]
        for parameter, gradient in zip(alone, gradients(0), strict=True):
            parameter.grad = gradient[member]
        norms.append(torch.nn.utils.clip_grad_norm_(alone, max_norm).item())
        for gradient, parameter in zip(clipped, alone, strict=True):
            torch.testing.assert_close(gradient[member], parameter.grad)
    assert norms[0] < max_norm < norms[2]


def test_clipping_by_a_norm_for_each_member() -> None:
    """Clipping of all by each of the norms."""
    clipped, norms = gradients(0), (1e-3, 9.0, 1.2)
    clip_per_member(clipped, torch.tensor(norms))
    for member, max_norm in enumerate(norms):
        expected = gradients(0)
        clip_per_member(expected, max_norm)
        for one, other in zip(clipped, expected, strict=True):
            torch.testing.assert_close(one[member], other[member])


def test_a_member_that_is_lost_takes_no_other_with_it() -> None:
    """NaN gradients of one member: the others' are as if it were not there."""
    broken, whole = gradients(0), gradients(0)
    broken[1][0] = torch.nan
    for parts in (broken, whole):
        clip_per_member(parts, 1.2)
    for one, other in zip(broken, whole, strict=True):
        torch.testing.assert_close(one[1:], other[1:], rtol=0, atol=0)


def test_sub_models_are_clipped_apart_by_the_paper_s_norms() -> None:
    """Appendix A: 1.2 for the transition model, 2 for the vision model, over all of its parameters together."""
    trained = module()
    for parameter in trained.parameters():
        parameter.grad = torch.full_like(parameter, 3.0)
    optimizer = trained.configure_optimizers()
    trained.configure_gradient_clipping(optimizer, gradient_clip_val=None, gradient_clip_algorithm=None)
    assert trained.stack.vision is not None
    for part, max_norm in ((trained.stack.transition, 1.2), (trained.stack.vision, 2.0)):
        for member in range(3):
            total = sum(p.grad[member].square().sum().item() for p in part.parameters() if p.grad is not None)
            assert total**0.5 == pytest.approx(max_norm, rel=1e-5)


def test_one_adam_with_the_paper_s_numbers_for_each_sub_model() -> None:
    """Appendix A, written out."""
    trained = module()
    optimizer = trained.configure_optimizers()
    assert isinstance(optimizer, torch.optim.Adam) and trained.stack.vision is not None
    transition, vision = optimizer.param_groups
    assert (transition["lr"], vision["lr"]) == (0.008, 0.00075)
    for group, part in ((transition, trained.stack.transition), (vision, trained.stack.vision)):
        assert [id(p) for p in group["params"]] == [id(p) for p in part.parameters()]
        assert (group["betas"], group["eps"]) == ((0.9, 0.999), 1e-4)
        assert (group["weight_decay"], group["amsgrad"]) == (0, False)


RATES = st.lists(st.floats(-5, 0).map(lambda exponent: 10**exponent), min_size=1, max_size=4)


@settings(max_examples=20, deadline=None)
@given(rates=RATES, vision=st.booleans(), members=st.integers(1, 2), seed=st.integers(0, 9))
def test_each_trial_has_an_adam_of_its_own(rates: list[float], vision: bool, members: int, seed: int) -> None:
    """`torch.optim.Adam`, not fused, on each member alone with its trial's learning rate, the other sub-model with the
    paper's; over some updates of made-up gradients."""
    changes = {"vision_lr" if vision else "transition_lr": rates}
    trained = module(3, len(rates) * tuple(range(members)), **changes)
    optimizer = trained.configure_optimizers()
    parameters = dict(trained.stack.named_parameters())
    generator = torch.Generator().manual_seed(seed)
    alone, adams = [], []
    for member in range(len(trained.stack.seeds)):
        own = {name: torch.nn.Parameter(each[member].detach().clone()) for name, each in parameters.items()}
        rate = {"transition": 0.008, "vision": 0.00075} | {
            "vision" if vision else "transition": rates[member // members]
        }
        groups = [{"params": [each], "lr": rate[name.partition(".")[0]]} for name, each in own.items()]
        alone.append(own)
        adams.append(torch.optim.Adam(groups, betas=(0.9, 0.999), eps=1e-4, foreach=False))
    for _ in range(3):
        for name, parameter in parameters.items():
            parameter.grad = 10 ** (-2 * torch.rand((), generator=generator)) * torch.randn(
                parameter.shape, generator=generator
            )
            for member, own in enumerate(alone):
                own[name].grad = parameter.grad[member].clone()
        for each in (optimizer, *adams):
            each.step()
    for member, own in enumerate(alone):
        for name, each in own.items():
            torch.testing.assert_close(parameters[name][member], each, rtol=1e-6, atol=1e-6, msg=f"{member}, {name}")


def test_without_a_context_there_is_one_group() -> None:
    """No vision model: nothing to train or clip there."""
    trained = module(0)
    (group,) = trained.configure_optimizers().param_groups
    assert sum(parameter[0].numel() for parameter in group["params"]) == 324 and group["lr"] == 0.008


class Remembering(torch.nn.Module):
    """A transition model that counts the chunks since the beginning of the sequences, in a carry with a gradient."""

    def __init__(self, inner: torch.nn.Module) -> None:
        super().__init__()
        self.inner = inner
        self.seen: list[tuple[float, Any]] = []

    def initial(self, num_sequences: int) -> tuple[Tensor]:
        return (torch.zeros(3, requires_grad=True),)

    def unroll(self, carry: tuple[Tensor], *inputs: Tensor) -> Any:
        self.seen.append((carry[0][0].item(), carry[0].grad_fn))
        return (carry[0] + 1,), self.inner.unroll((), *inputs)[1]  # type: ignore[operator]


def test_a_carry_goes_from_chunk_to_chunk_without_its_gradient_and_begins_anew() -> None:
    """Counted by hand: what a recurrent transition model would get in chunks 1, 2, 3 and again 1."""
    trained = module(0)
    trained.stack.transition = memory = Remembering(trained.stack.transition)  # type: ignore[assignment]
    for is_first in (True, False, False, True):
        trained.loss(batch(is_first))
    assert memory.seen == [(0.0, None), (1.0, None), (2.0, None), (0.0, None)]


def test_a_training_step_is_an_update_on_each_of_its_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Updates by hand on the same batches, bit by bit; the losses before them are kept in their order."""
    together, one_by_one = module(), module()
    batches = [batch(seed == 0, seed) for seed in range(3)]
    optimizer = one_by_one.configure_optimizers()
    expected = [one_by_one.update(each, optimizer) for each in batches]
    monkeypatch.setattr(together, "optimizers", together.configure_optimizers)
    together.training_step(batches, 0)
    assert torch.equal(torch.stack(together._losses), torch.stack(expected))
    for mine, its in zip(together.stack.parameters(), one_by_one.stack.parameters(), strict=True):
        assert torch.equal(mine, its)


TERMS = {"encoder": "centered", "paste": 0.5, "effect_std": 0.1, "penalty": 0.01}


def pasted(seed: int = 3) -> Windows:
    """Five pairs of views of one channel."""
    views = torch.rand(1, 5, 2, 1, 11, 11, generator=torch.Generator().manual_seed(seed)) < 0.3
    first, second = views.unbind(2)
    return take_apart(torch.stack([first, second, first | second, torch.zeros_like(first)], dim=2))


@pytest.mark.usefixtures("loops")
@pytest.mark.parametrize("key", ["paste", "effect_std", "penalty"])
def test_terms_of_codes_are_part_of_an_update_and_not_of_the_loss(key: str) -> None:
    """The gradients of the likelihood plus the term by hand; the loss that is reported is the likelihood alone. All
    models of the paper's kind, whose compiled loops know no terms."""
    settings = MLPSettings.model_validate({"kind": "mlp", "encoder": "plain", "paste": 0.0, "effect_std": 0.0,
                                           "penalty": 0.0, key: TERMS[key]})  # fmt: skip
    trained, bare = module(transition=settings, transition_max_norm=1e9, vision_max_norm=1e9), module()
    data = batch()._replace(pasted=pasted())
    losses = trained.update(data, trained.configure_optimizers())
    code = bare.stack.encode(data.views)
    _, prediction = bare.stack.transition.unroll((), code, data.delta, data.action)
    _, free = bare.stack.transition.unroll((), torch.zeros_like(code), data.delta, data.action)
    assert data.pasted is not None
    term = {
        "paste": 0.5 * composition_gap(bare.stack.encode(data.pasted)),
        "effect_std": 0.5 * ((prediction.mean - free.mean) / 0.1).square().sum(-1).mean((1, 2)),
        "penalty": 0.01 * (code.abs().mean((1, 2, 3)) + total_correlation(code)),
    }[key]
    likelihood = bare.loss(data)
    torch.testing.assert_close(losses, likelihood.detach())
    (likelihood + term).sum().backward()
    optimizer = bare.configure_optimizers()
    optimizer.step()
    for mine, theirs in zip(trained.stack.parameters(), bare.stack.parameters(), strict=True):
        torch.testing.assert_close(mine, theirs)
    assert (term.detach() > 0).all()


def test_a_member_with_terms_is_trained_as_if_alone() -> None:
    """Two updates with all terms, of three members and of the last of them."""
    settings = EffectsSettings.load("model/transition", "split", **TERMS)
    together, alone = module(8, transition=settings), module(8, (2,), transition=settings)
    for trained in (together, alone):
        optimizer = trained.configure_optimizers()
        for seed in (0, 1):
            trained.update(batch(seed=seed)._replace(pasted=pasted(seed)), optimizer)
    for whole, single in zip(together.stack.parameters(), alone.stack.parameters(), strict=True):
        torch.testing.assert_close(whole[2:], single)


def test_learning_rates_cool_down_over_the_last_epochs() -> None:
    """By hand: ten epochs, the last four at 10^(-1/4), 10^(-2/4), ..., 0.1; and none without a share."""
    factors = [cooldown(epoch, 10, 0.4) for epoch in range(10)]
    assert factors == pytest.approx([1.0] * 6 + [10**-0.25, 10**-0.5, 10**-0.75, 0.1])
    assert {cooldown(epoch, 10, 0.0) for epoch in range(10)} == {1.0}
