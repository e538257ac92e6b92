"""Look-ups against each other, `grid_sample`, finite differences, and each member alone."""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest
import torch
from torch import Tensor

from affmap.env.layout import Layout
from affmap.model.lookup import AffordanceMap, ExactLookup, Lookup, LookupSettings, inside, lookup_error, make_lookup
from affmap.model.stack import ModelSettings, Stack
from affmap.model.windows import take_apart
from affmap.settings import ConfigError
from affmap.view import VisibleLayout, view

WORLD = Layout.load("layout", "original").map
EXACT = LookupSettings.load("lookup", "exact")
COARSE = LookupSettings.load("lookup", "map", spacing=0.5)
SEEDS = (4, 5, 6)
pytestmark = pytest.mark.usefixtures("loops")


def stack(*seeds: int, context_size: int = 3) -> Stack:
    """Untrained; codes of untrained models differ little between places, so they are stretched."""
    made = Stack(ModelSettings.load("model", "default", context_size=context_size), WORLD.num_channels, seeds)
    if made.vision is not None:
        with torch.no_grad():
            for parameter in made.vision.parameters():
                parameter *= 3
    return made.requires_grad_(False)


def places(*shape: int, seed: int = 0, margin: float = 0.0, dtype: torch.dtype = torch.float32) -> Tensor:
    """Positions `[*shape, 2]` in the arena, or up to `margin` outside."""
    size = torch.tensor(WORLD.size, dtype=dtype)
    uniform = torch.rand(*shape, 2, generator=torch.Generator().manual_seed(seed), dtype=dtype)
    return uniform * (size + 2 * margin) - margin


def random_map(differentiable: bool = False) -> AffordanceMap:
    """Codes `[3, 8, 13, 5]` without any order, float64."""
    codes = torch.randn(3, 8, 13, 5, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    return AffordanceMap(codes, [WORLD], differentiable)


def nodes(painted: AffordanceMap) -> Tensor:
    """Positions of the nodes, `[Y, X, 2]`."""
    _, rows, columns, _ = painted.codes.shape
    width, height = painted.worlds[0].size
    y, x = torch.meshgrid(torch.linspace(0, height, rows), torch.linspace(0, width, columns), indexing="ij")
    return torch.stack([x, y], dim=-1)


def test_an_exact_code_is_the_member_s_own_code_of_the_view() -> None:
    """Each member alone, each place alone."""
    whole, positions = stack(*SEEDS), places(3, 4, 2)
    codes = ExactLookup(whole, [WORLD])(positions)
    assert codes.shape == (3, 4, 2, 3)
    for member, seed in enumerate(SEEDS):
        alone = stack(seed)
        for i in range(4):
            for j in range(2):
                code = alone.encode(take_apart(view(WORLD, positions[member, i, j])[None, None]))
                torch.testing.assert_close(codes[member, i, j], code[0, 0])
    assert (codes.std(dim=(1, 2)) > 1e-3).all()  # places differ, or this would show nothing


def test_the_error_of_a_look_up_is_its_distance_from_the_exact_one() -> None:
    """By hand for a map, and zero for the exact look-up itself."""
    whole, positions = stack(*SEEDS), places(3, 9)
    exact, painted = ExactLookup(whole, [WORLD]), AffordanceMap.paint(whole, [WORLD], 0.5)
    expected = (painted(positions) - exact(positions)).abs().mean(-1)
    torch.testing.assert_close(lookup_error(painted, exact, positions), expected)
    assert (expected > 1e-4).any() and (lookup_error(exact, exact, positions) == 0).all()


def test_at_its_nodes_the_map_is_exact() -> None:
    """Against the exact look-up, all members and all nodes, corners and borders included."""
    whole = stack(*SEEDS)
    painted = AffordanceMap.paint(whole, [WORLD], spacing=0.1)
    assert painted.codes.shape == (3, 21, 31, 3)
    at_nodes = nodes(painted)
    exact = ExactLookup(whole, [WORLD])(at_nodes.expand(3, -1, -1, -1))
    torch.testing.assert_close(painted.codes, exact)
    torch.testing.assert_close(painted(at_nodes.expand(3, -1, -1, -1)), exact, atol=1e-4, rtol=0)
    assert (exact.std(dim=(1, 2)) > 1e-3).all()


@pytest.mark.parametrize("margin", [0.0, 0.5])
def test_between_nodes_it_is_grid_sample(margin: float) -> None:
    """torch's own bilinear interpolation, border replicated; float64."""
    painted, positions = random_map(), places(3, 7, 11, margin=margin, dtype=torch.float64)
    grid = 2 * positions / torch.tensor(WORLD.size) - 1
    expected = torch.nn.functional.grid_sample(
        painted.codes.permute(0, 3, 1, 2), grid, mode="bilinear", padding_mode="border", align_corners=True
    )
    torch.testing.assert_close(painted(positions), expected.permute(0, 2, 3, 1))


def test_between_two_nodes_it_is_their_weighted_mean() -> None:
    """Closed form, on one cell: rows are y, columns are x."""
    codes = torch.tensor([[[[0.0], [1.0]], [[10.0], [31.0]]]])
    painted = AffordanceMap(codes, [VisibleLayout((3.0, 2.0), 1, 0, ())])
    found = painted(
        torch.tensor([[[0.0, 0.0], [3.0, 0.0], [0.0, 2.0], [3.0, 2.0], [0.75, 0.0], [0.0, 0.5], [1.5, 1.0]]])
    )
    torch.testing.assert_close(found[0, :, 0], torch.tensor([0.0, 1.0, 10.0, 31.0, 0.25, 2.5, 10.5]))


def test_a_finer_map_is_nearer_to_the_exact_one() -> None:
    """On average over 600 places; the code jumps where a pixel does, so no single place need be."""
    whole, positions = stack(*SEEDS), places(3, 600)
    exact = ExactLookup(whole, [WORLD])(positions)
    errors = [
        (AffordanceMap.paint(whole, [WORLD], spacing)(positions) - exact).abs().mean().item()
        for spacing in (0.2, 0.1, 0.05, 0.025)
    ]
    assert all(finer < 0.9 * coarser for coarser, finer in pairwise(errors)), errors
    assert errors[-1] < 0.3 * errors[0], errors


@pytest.mark.parametrize(
    ("spacing", "columns", "rows"), [(0.5, 7, 5), (0.7, 6, 4), (0.45, 8, 6), (1.7, 3, 3), (5.0, 2, 2), (1e9, 2, 2)]
)
def test_nodes_are_at_most_the_spacing_apart(spacing: float, columns: int, rows: int) -> None:
    """Counted by hand for 3 x 2 u: the smallest number of equal parts none of which is longer."""
    painted = AffordanceMap.paint(stack(4), [WORLD], spacing)
    assert painted.codes.shape == (1, rows, columns, 3)
    assert math.ceil(WORLD.size[0] / spacing) == columns - 1 and math.ceil(WORLD.size[1] / spacing) == rows - 1
    assert painted(places(1, 5, margin=1)).isfinite().all()
    again = painted.elsewhere(stack(4), [WORLD])  # not by the distance of columns, which may be shorter
    assert torch.equal(again.codes, painted.codes) and again.spacing == spacing
    assert AffordanceMap(painted.codes, [WORLD]).spacing == 3 / (columns - 1)


def test_the_configured_spacing_gives_the_nodes_one_expects() -> None:
    """3 x 2 u at 0.02 u: 151 x 101 nodes, whatever 3 / 0.02 rounds to; the same for other decimal spacings."""
    assert LookupSettings.load("lookup", "map").spacing == 0.02
    nothing = stack(4, context_size=0)
    for spacing, columns, rows in ((0.01, 301, 201), (0.02, 151, 101), (0.03, 101, 68), (0.04, 76, 51), (0.1, 31, 21)):
        assert AffordanceMap.paint(nothing, [WORLD], spacing).codes.shape == (1, rows, columns, 0)


@pytest.mark.parametrize("settings", [EXACT, COARSE])
def test_outside_the_arena_is_the_nearest_point_inside(settings: LookupSettings) -> None:
    """Against the clipped positions; far away and infinite ones too."""
    whole = stack(*SEEDS)
    lookup = make_lookup(settings, whole, [WORLD])
    positions = places(3, 40, margin=1.0)
    positions[:, 0] = torch.tensor([1e6, -1e6])
    positions[:, 1] = torch.tensor([-torch.inf, torch.inf])
    clipped = torch.stack([positions[..., 0].clamp(0, 3), positions[..., 1].clamp(0, 2)], dim=-1)
    assert (clipped != positions).any()
    assert torch.equal(inside(positions, torch.tensor(WORLD.size)), clipped)
    assert torch.equal(lookup(positions), lookup(clipped))


def finite_differences(lookup: Lookup, positions: Tensor, weights: Tensor, step: float = 1e-6) -> Tensor:
    """Central differences of the weighted sum of codes, `[M, P, 2]`."""
    columns = []
    for axis in range(2):
        offset = torch.zeros(2, dtype=positions.dtype)
        offset[axis] = step
        change = (lookup(positions + offset) - lookup(positions - offset)) / (2 * step)
        columns.append((weights * change).sum(-1))
    return torch.stack(columns, dim=-1)


def test_gradients_are_those_of_finite_differences() -> None:
    """Float64; inside cells (0.25 u and 2/7 u wide) and outside the arena, where the nearest point stays."""
    painted = random_map(differentiable=True)
    cell = torch.tensor([0.25, 2 / 7], dtype=torch.float64)
    within = 0.1 + 0.8 * torch.rand(3, 30, 2, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    which = torch.stack([torch.randint(0, n, (3, 30), generator=torch.Generator().manual_seed(n)) for n in (12, 7)], -1)
    positions = (which + within) * cell
    positions[:, 0, 0] = -0.2
    positions[:, 1, 1] = 2.2
    weights = torch.randn(3, 30, 5, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    expected = finite_differences(painted, positions, weights)
    positions.requires_grad_()
    (gradient,) = torch.autograd.grad((weights * painted(positions)).sum(), positions)
    torch.testing.assert_close(gradient, expected, atol=1e-6, rtol=1e-6)
    assert (gradient[:, 0, 0] == 0).all() and (gradient[:, 1, 1] == 0).all() and (gradient[:, 2:] != 0).all()


@pytest.mark.parametrize("settings", [EXACT, COARSE])
def test_no_gradients_flow_to_the_position_unless_asked_for(settings: LookupSettings) -> None:
    """The paper's do not (Figure 1): the codes are constants."""
    lookup = make_lookup(settings, stack(*SEEDS), [WORLD])
    assert not lookup(places(3, 5).requires_grad_()).requires_grad


def test_asking_for_gradients_does_not_change_codes() -> None:
    """Bit for bit."""
    positions = places(3, 50, margin=0.3, dtype=torch.float64)
    assert torch.equal(random_map(True)(positions.requires_grad_()).detach(), random_map(False)(positions))


def test_members_of_a_map_see_their_own_codes() -> None:
    """Together equals alone."""
    together, positions = AffordanceMap.paint(stack(*SEEDS), [WORLD], 0.2), places(3, 9, 2)
    codes = together(positions)
    for member, seed in enumerate(SEEDS):
        alone = AffordanceMap.paint(stack(seed), [WORLD], 0.2)
        torch.testing.assert_close(together.codes[member], alone.codes[0])
        torch.testing.assert_close(codes[member], alone(positions[member : member + 1])[0])
    assert (codes[0] - codes[1]).abs().max() > 1e-2


@pytest.mark.parametrize("settings", [EXACT, COARSE])
def test_problems_in_worlds_of_their_own_are_each_alone(settings: LookupSettings) -> None:
    """Three members with two problems each, five paths a problem: against one member's look-up in one world."""
    worlds = [VisibleLayout((3.0, 2.0), 1, 0, ((0.4 + 0.4 * number, 1.0, 0.3, 0),)) for number in range(6)]
    positions = places(3, 10, margin=0.2)  # [M, problems * paths, 2], problem-major
    codes = make_lookup(settings, stack(*SEEDS), worlds)(positions)
    assert codes.shape == (3, 10, 3)
    for number, world in enumerate(worlds):
        member, own = number // 2, slice(5 * (number % 2), 5 * (number % 2) + 5)
        alone = make_lookup(settings, stack(SEEDS[member]), [world])(positions[member : member + 1, own])
        torch.testing.assert_close(codes[member, own], alone[0])
    shared = make_lookup(settings, stack(*SEEDS), worlds[:1])(positions)
    assert (codes - shared).abs().max() > 1e-2


@pytest.mark.parametrize("settings", [EXACT, COARSE])
@pytest.mark.parametrize("num_worlds", [1, 3, 6])
def test_two_look_ups_are_merged_world_by_world(settings: LookupSettings, num_worlds: int) -> None:
    """Six problems of three members, from shared worlds and their own: each has the codes of its own look-up."""
    first, second = (
        make_lookup(
            settings, stack(*SEEDS), [VisibleLayout((3.0, 2.0), 1, 0, ((x + n / 9, 1.0, 0.3, 0),)) for n in each]
        )
        for x, each in ((0.5, range(num_worlds)), (2.0, range(num_worlds)))
    )
    from_second = [True, False, False, True, True, False]
    positions = places(3, 10, margin=0.2)
    merged = first.merged(second, from_second)
    expected = torch.where(
        torch.tensor(from_second).view(3, 2).repeat_interleave(5, 1)[..., None], second(positions), first(positions)
    )
    torch.testing.assert_close(merged(positions), expected)
    assert type(merged) is type(first) and len(merged.worlds) == 6
    assert merged.worlds[0] == second.worlds[0] and merged.worlds[-1] == first.worlds[-1]


@pytest.mark.parametrize("settings", [EXACT, COARSE])
def test_without_a_context_codes_are_empty(settings: LookupSettings) -> None:
    lookup = make_lookup(settings, stack(4, 5, context_size=0), [WORLD])
    assert lookup(places(2, 3, 4)).shape == (2, 3, 4, 0)


LAYOUT = Layout.load("layout", "original")


@pytest.mark.parametrize("worlds", ["fog", ["fog"], LAYOUT, [LAYOUT], WORLD, [], 3])
def test_what_are_no_worlds_is_told(worlds: Any) -> None:
    one = stack(4)
    uses: list[Callable[[], Any]] = [
        lambda: AffordanceMap.paint(one, worlds, 0.5),
        lambda: ExactLookup(one, worlds),
        lambda: AffordanceMap.paint(one, [WORLD], 0.5).elsewhere(one, worlds),
    ]
    for use in uses:
        with pytest.raises(
            ConfigError, match=r"^worlds = .* is not allowed; give a list .*, such as \[layout\.map\]\.$"
        ):
            use()


def test_make_lookup_makes_what_is_named() -> None:
    """The configured files: an exact look-up, and a map of the spacing given, differentiable on request only."""
    whole = stack(4)
    assert isinstance(make_lookup(EXACT, whole, [WORLD]), ExactLookup)
    for differentiable in (False, True):
        settings = LookupSettings.load("lookup", "map", spacing=0.5, differentiable=differentiable)
        lookup = make_lookup(settings, whole, [WORLD])
        assert isinstance(lookup, AffordanceMap) and lookup.codes.shape == (1, 5, 7, 3)
        assert lookup(places(1, 5).requires_grad_()).requires_grad == differentiable


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"spacing": 0.0, "differentiable": True}, "differentiable = True needs an affordance map"),
        ({"spacing": -0.01}, "spacing = -0.01 is not allowed"),
    ],
)
def test_bad_settings_are_named(changes: dict[str, Any], message: str) -> None:
    """Golden parts of the message."""
    with pytest.raises(ValueError, match=message):
        LookupSettings.load("lookup", "map", **changes)
