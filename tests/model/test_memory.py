"""The network of a memorised map against plain sums and normal equations in float64, and each agent alone."""

import numpy as np
import pytest
import torch
from torch import Tensor

from affmap.env.layout import Layout
from affmap.model.lookup import AffordanceMap
from affmap.model.memory import Memory, MemorySettings, PlaceNetwork

SIZE = (0.9, 0.6)
SETTINGS = MemorySettings.load("memory", "repaired")
NETWORK = PlaceNetwork(SIZE, SETTINGS)
WORLD = Layout.load("layout", "original").map


def centers() -> np.ndarray:
    """Of the units, `[U, 2]`: a grid of 0.15 u that goes one step beyond each border, row by row."""
    x, y = (np.linspace(-0.15, length + 0.15, round(length / 0.15) + 3) for length in SIZE)
    return np.array([[each, row] for row in y for each in x])


def plain(places: np.ndarray) -> np.ndarray:
    """Activations at places `[N, 2]`: `[N, U]`, one number at a time."""
    return np.array([[np.exp(-((p - c) ** 2).sum() / (2 * 0.2**2)) for c in centers()] for p in places])


def drawn(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def places(*shape: int, seed: int = 0) -> Tensor:
    """Uniformly distributed places in the arena, `[*shape, 2]`."""
    return torch.rand(*shape, 2, generator=torch.Generator().manual_seed(seed)) * torch.tensor(SIZE)


def memory(seed: int = 0) -> Memory:
    """That of three agents, with weights and covariances of their own."""
    roots = drawn(3, NETWORK.num_units, NETWORK.num_units, seed=seed)
    return Memory(drawn(3, NETWORK.num_units, 2, seed=seed + 1), roots @ roots.mT / NETWORK.num_units)


def test_activations_are_gaussian_bells_around_the_nodes_of_a_grid() -> None:
    some = places(4, 5)
    assert NETWORK.num_units == len(centers())
    torch.testing.assert_close(
        NETWORK.activations(some), torch.from_numpy(plain(some.flatten(0, 1).numpy())).float().view(4, 5, -1)
    )


def test_exploration_is_ridge_regression_of_each_member_alone() -> None:
    """Against the stacked system of equations, whose least squares solution has the penalty as further rows."""
    some, codes = places(5000), drawn(2, 5000, 3)
    found = NETWORK.explored(some, codes)
    active = plain(some.numpy().astype(float)) / np.sqrt(5000)
    rows = np.concatenate([active, np.sqrt(SETTINGS.ridge) * np.eye(NETWORK.num_units)])
    for member in range(2):
        targets = np.concatenate([codes[member].numpy() / np.sqrt(5000), np.zeros((NETWORK.num_units, 3))])
        expected = np.linalg.lstsq(rows, targets, rcond=None)[0]
        np.testing.assert_allclose(found.weights[member].numpy(), expected, rtol=1e-3, atol=1e-3)
    assert torch.equal(found.covariance, torch.eye(NETWORK.num_units).repeat(2, 1, 1))


def test_a_smooth_map_is_learned_where_it_was_seen() -> None:
    """Codes that vary over half a metre are within a hundredth at places that were not seen themselves."""

    def true(where: Tensor) -> Tensor:
        return torch.stack([(6 * where[..., 0]).sin(), (4 * where.sum(-1)).cos()], -1)

    known = NETWORK.explored(places(3000), true(places(3000))[None])
    new = places(1, 200, seed=1)
    assert (NETWORK.recalled(known, new) - true(new)).abs().max() < 0.01


def test_learning_in_flight_is_the_least_change_that_explains_what_was_seen() -> None:
    """Twenty steps one by one against one regularised system of equations, each agent alone."""
    start = Memory(drawn(3, NETWORK.num_units, 2), torch.eye(NETWORK.num_units).repeat(3, 1, 1))
    way, codes = places(20, 3, seed=2), drawn(20, 3, 2, seed=3)
    after = start
    for step in range(20):
        after = NETWORK.learned(after, way[step], codes[step])
    for agent in range(3):
        active, before = plain(way[:, agent].numpy().astype(float)), start.weights[agent].double().numpy()
        square = active.T @ active / SETTINGS.noise + np.eye(NETWORK.num_units)
        missed = codes[:, agent].double().numpy() - active @ before
        expected = before + np.linalg.solve(square, active.T @ missed / SETTINGS.noise)
        np.testing.assert_allclose(after.weights[agent].numpy(), expected, atol=1e-3)
        np.testing.assert_allclose(after.covariance[agent].numpy(), np.linalg.inv(square), atol=1e-3)


def test_agents_learn_side_by_side_as_each_does_alone() -> None:
    whole, where, codes = memory(), places(3), drawn(3, 2, seed=5)
    together = NETWORK.learned(whole, where, codes)
    for agent in range(3):
        own = slice(agent, agent + 1)
        alone = NETWORK.learned(Memory(*(part[own] for part in whole)), where[own], codes[own])
        for part, mine in zip(together, alone, strict=True):
            torch.testing.assert_close(part[own], mine)
    assert not torch.allclose(together.weights, whole.weights)


def test_the_last_sight_counts_more_than_what_was_remembered_and_far_places_are_kept() -> None:
    """Where weights are as uncertain as when a flight begins, it is nearly believed; 0.9 u away nothing changes."""
    before = Memory(drawn(1, NETWORK.num_units, 2), torch.eye(NETWORK.num_units)[None])
    here, there = torch.tensor([[0.0, 0.0]]), torch.tensor([[0.9, 0.6]])
    after = NETWORK.learned(before, here, torch.tensor([[1.0, -1.0]]))
    old = NETWORK.recalled(before, here[:, None]) - torch.tensor([1.0, -1.0])
    new = NETWORK.recalled(after, here[:, None]) - torch.tensor([1.0, -1.0])
    assert (new.abs() < 0.1 * old.abs()).all()
    torch.testing.assert_close(*(NETWORK.recalled(each, there[:, None]) for each in (after, before)), atol=1e-2, rtol=0)


@pytest.mark.parametrize("spacing", [0.1, 0.07])
def test_the_painted_map_is_what_is_remembered_at_each_node(spacing: float) -> None:
    """At the nodes of an affordance map of the same spacing; between them, it is interpolated."""
    whole, network = memory(), PlaceNetwork(SIZE, SETTINGS)
    codes = network.painted(whole, spacing)
    _, rows, columns, _ = codes.shape
    assert SIZE[0] / spacing <= columns - 1 < SIZE[0] / spacing + 1
    y, x = torch.meshgrid(torch.linspace(0, SIZE[1], rows), torch.linspace(0, SIZE[0], columns), indexing="ij")
    nodes = torch.stack([x, y], -1).flatten(0, 1).expand(3, -1, -1)
    torch.testing.assert_close(codes.flatten(1, 2), network.recalled(whole, nodes), atol=1e-4, rtol=1e-4)


def test_nothing_is_remembered_at_first() -> None:
    """Zeros everywhere, on a map over the whole arena; networks side by side are copies."""
    nothing = PlaceNetwork(WORLD.size, SETTINGS).empty(2, 3)
    painted = AffordanceMap(PlaceNetwork(WORLD.size, SETTINGS).painted(nothing, 0.5), [WORLD] * 2)
    assert (painted(places(2, 7)) == 0).all()
    whole = memory()
    for part, twice in zip(whole, whole.repeated(2), strict=True):
        assert torch.equal(twice, torch.stack([part, part], 1).flatten(0, 1))
