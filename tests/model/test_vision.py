"""The vision model: the paper's numbers of parameters, and plain convolutions, pooling and linear layers."""

import pytest
import torch
from torch import Tensor
from torch.nn.functional import conv2d, linear, max_pool2d

from affmap.env.layout import Layout
from affmap.model.registry import Encoder
from affmap.model.stack import ModelSettings, Stack
from affmap.model.vision import VisionModel, sizes
from affmap.model.windows import take_apart
from affmap.view import view

CONTEXT_SIZES = [1, 3, 5, 8, 16, 32]
CHANNELS = [1, 2, 3, 4]


def vision(context_size: int, channels: int, members: int = 3, encoder: Encoder = "plain") -> VisionModel:
    generators = [torch.Generator().manual_seed(seed) for seed in range(members)]
    return VisionModel(generators, channels, context_size, encoder)


def real_views(count: int, channels: int, seed: int = 0) -> Tensor:
    """`[count, K, 11, 11]`, at random places of Experiment I's circles in `channels` channels in turn."""
    names = [f"channel {number}" for number in range(channels)]
    original = Layout.load("layout", "original")
    circles = [circle.model_dump() | {"channel": names[n % channels]} for n, circle in enumerate(original.circles)]
    layout = Layout.load("layout", "original", channels=names, border_channel=names[-1], circles=circles)
    places = torch.rand(count, 2, generator=torch.Generator().manual_seed(seed)) * torch.tensor(layout.size)
    return view(layout.map, places)


def plainly(model: VisionModel, member: int, views: Tensor) -> tuple[Tensor, list[Tensor]]:
    """Appendix A written down with torch's own layers; code of one member, and copies of its weights in order."""
    own = [parameter.detach()[member].clone().requires_grad_() for _, parameter in sorted(model.named_parameters())]
    conv1_bias, conv1, conv2_bias, conv2, bias1, weight1, bias2, weight2 = own
    features = max_pool2d(conv2d(views.float(), conv1, conv1_bias).tanh(), 3, 2)
    flat = conv2d(features, conv2, conv2_bias).tanh().flatten(1)
    return linear(linear(flat, weight1.T, bias1).tanh(), weight2.T, bias2).tanh(), own


def assert_plain(model: VisionModel, codes: Tensor, views: Tensor) -> None:
    """Codes `[M, P, C]` and the gradients of a random projection of them, for views `[M or 1, P, K, 11, 11]`."""
    slope = torch.randn(codes.shape, generator=torch.Generator().manual_seed(5))
    model.zero_grad()
    (codes * slope).sum().backward()
    for member in range(len(codes)):
        expected, own = plainly(model, member, views[member % len(views)])
        torch.testing.assert_close(codes[member], expected, rtol=1e-4, atol=2e-6)
        (expected * slope[member]).sum().backward()
        for (name, parameter), copy in zip(sorted(model.named_parameters()), own, strict=True):
            assert parameter.grad is not None and copy.grad is not None and copy.grad.abs().max() > 0
            torch.testing.assert_close(parameter.grad[member], copy.grad, rtol=1e-3, atol=2e-5, msg=name)


@pytest.mark.parametrize("channels", CHANNELS)
@pytest.mark.parametrize("context_size", CONTEXT_SIZES)
def test_number_of_parameters(context_size: int, channels: int) -> None:
    """Appendix A's formulas; the middle one without its slip (C counted twice for C = 8), see FACTS.md."""
    if context_size < 5:
        expected = 564 + 36 * channels + 9 * context_size
    elif context_size <= 16:
        expected = 828 + 36 * channels + 17 * context_size
    else:
        expected = 4312 + 72 * channels
    parameters = list(vision(context_size, channels).parameters())
    assert sum(parameter[0].numel() for parameter in parameters) == expected
    assert all(len(parameter) == 3 for parameter in parameters)


def test_the_printed_number_holds_at_context_size_8() -> None:
    """964 of Appendix A is 828 + 17 * 8."""
    assert sum(parameter[0].numel() for parameter in vision(8, 1).parameters()) == 964 + 36


@pytest.mark.parametrize(
    ("context_size", "expected"),
    [(1, (4, 8)), (4, (4, 8)), (5, (4, 16)), (16, (4, 16)), (31, (4, 16)), (32, (8, 32)), (33, (8, 32))],
)
def test_sizes(context_size: int, expected: tuple[int, int]) -> None:
    """Appendix A; context sizes between the paper's go with the smaller one."""
    assert sizes(context_size) == expected


@pytest.mark.parametrize("channels", CHANNELS)
@pytest.mark.parametrize("context_size", CONTEXT_SIZES)
def test_values_and_gradients_with_views_of_each_member_s_own(context_size: int, channels: int) -> None:
    """Plain torch layers for each member, on views full of noise."""
    model = vision(context_size, channels)
    views = torch.rand(3, 5, channels, 11, 11, generator=torch.Generator().manual_seed(1)) < 0.5
    codes = model.encode(take_apart(views))
    assert codes.shape == (3, 5, context_size)
    assert_plain(model, codes, views)


@pytest.mark.parametrize("channels", CHANNELS)
@pytest.mark.parametrize("context_size", CONTEXT_SIZES)
def test_values_and_gradients_with_shared_views_of_a_real_world(context_size: int, channels: int) -> None:
    """Plain torch layers for each member; equal patches, and so ties in the pooling, abound here."""
    model = vision(context_size, channels)
    views = real_views(40, channels)[None]
    codes = model.encode(take_apart(views))
    assert codes.shape == (3, 40, context_size)
    assert_plain(model, codes, views)


@pytest.mark.parametrize("leading", [(1, 4), (1, 2, 3), (3, 2, 1, 2), (1, 1)])
def test_any_leading_shape(leading: tuple[int, ...]) -> None:
    """Same as the views in one row."""
    model = vision(3, 2)
    views = torch.rand(*leading, 2, 11, 11, generator=torch.Generator().manual_seed(2)) < 0.3
    codes = model.encode(take_apart(views))
    assert codes.shape == (3, *leading[1:], 3)
    row = model.encode(take_apart(views.flatten(1, -4)))
    torch.testing.assert_close(codes.flatten(1, -2), row, rtol=0, atol=0)


def test_shared_views_are_the_same_as_giving_each_member_a_copy() -> None:
    """The two ways of gathering give the same codes."""
    model, views = vision(8, 1), real_views(30, 1)[None]
    copies = views.expand(3, *views.shape[1:])
    torch.testing.assert_close(model.encode(take_apart(views)), model.encode(take_apart(copies)))


def test_a_code_does_not_depend_on_the_other_views() -> None:
    """Each view alone: which windows are known to be distinct does not matter."""
    model, views = vision(8, 2), real_views(20, 2)[None]
    together = model.encode(take_apart(views))
    alone = torch.cat([model.encode(take_apart(views[:, n : n + 1])) for n in range(20)], dim=1)
    torch.testing.assert_close(together, alone)


def test_a_wrong_number_of_members_is_an_error_and_not_a_broadcast() -> None:
    """Two sets of views for three members mean nothing."""
    with pytest.raises((RuntimeError, IndexError)):
        vision(3, 1).encode(take_apart(torch.zeros(2, 4, 1, 11, 11, dtype=torch.bool)))


def test_there_is_no_vision_model_at_context_size_0() -> None:
    """FACTS.md: the transition model's 324 parameters are all; codes are empty, in the right shape."""
    settings = ModelSettings.load("model", "default", context_size=0)
    stack = Stack(settings, 1, [0, 1])
    assert stack.vision is None
    assert sum(parameter[0].numel() for parameter in stack.parameters()) == 324
    for members in (1, 2):
        views = torch.zeros(members, 4, 5, 1, 11, 11, dtype=torch.bool)
        assert stack.encode(take_apart(views)).shape == (2, 4, 5, 0)


def test_centered_codes_are_plain_ones_less_that_of_the_empty_view() -> None:
    """The same weights with `plain`; the empty view itself has the code 0."""
    views = torch.cat([real_views(20, 3), torch.zeros(1, 3, 11, 11, dtype=torch.bool)])
    plain = vision(8, 3).encode(take_apart(views[None]))
    centered = vision(8, 3, encoder="centered").encode(take_apart(views[None]))
    torch.testing.assert_close(centered, plain - plain[:, -1:])
    assert (centered[:, -1].abs() < 1e-6).all() and (centered[:, 0].abs() > 1e-3).any()


def test_each_channel_has_units_of_its_own() -> None:
    """Plain codes of views that have one channel only; 8 units of 3 channels are 2, 3 and 3."""
    views = real_views(20, 3)
    model, plain = vision(8, 3, encoder="channels"), vision(8, 3)
    codes = model.encode(take_apart(views[None]))
    nothing = plain.encode(take_apart(torch.zeros_like(views)[None]))
    assert [units for _, units in model.units()] == [slice(0, 2), slice(2, 5), slice(5, 8)]
    for channel, units in model.units():
        alone = torch.zeros_like(views)
        alone[:, channel] = views[:, channel]
        expected = (plain.encode(take_apart(alone[None])) - nothing)[..., units]
        torch.testing.assert_close(codes[..., units], expected)
        assert expected.any()


def test_codes_of_channels_add_up() -> None:
    """Views without a channel in common, laid over each other: the sum of their codes, whatever the weights are."""
    views = real_views(20, 3)
    first, second = views.clone(), views.flip(0)
    first[:, 1:], second[:, 0] = False, False
    model = vision(8, 3, encoder="channels")
    one, other, both = (model.encode(take_apart(each[None])) for each in (first, second, first | second))
    torch.testing.assert_close(both, one + other)


@pytest.mark.parametrize("encoder", ["centered", "channels"])
def test_gradients_of_other_codes_are_those_of_differences(encoder: Encoder) -> None:
    """Numerical differences of the sum of all codes, in two weights of each layer."""
    views = take_apart(real_views(5, 2)[None])
    model = vision(4, 2, members=1, encoder=encoder).double()
    views = views._replace(patches=views.patches.double())
    model.encode(views).sum().backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None
        for place in (0, parameter.numel() - 1):
            sums = []
            for change in (-1e-5, 1e-5):
                with torch.no_grad():
                    parameter.view(-1)[place] += change
                    sums.append(model.encode(views).sum())
                    parameter.view(-1)[place] -= change
            torch.testing.assert_close(parameter.grad.view(-1)[place], (sums[1] - sums[0]) / 2e-5, msg=name)
