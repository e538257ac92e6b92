"""The halo of fog: by hand, in worlds and with deviations that are written down here."""

import numpy as np
import pytest
from stage_files import make_world

from affmap.env.layout import Layout
from affmap.results.files import Deviations
from affmap.results.halo import UNCERTAIN, WIDTH, beyond, fog_distance, halo

RADIUS = 0.06
WORLD = make_world((1.5, 1.0, 0.3, "fog"), (0.5, 0.5, 0.2, "obstacle"))
X, Y = np.arange(301) * 0.01, np.arange(201) * 0.01


def deviations(*edges: float) -> Deviations:
    """Deviations of members that mistake circles of some radii (u) around the fog's centre for fog; along y only."""
    distance = np.hypot(*(np.stack(np.meshgrid(X, Y)) - np.array([1.5, 1.0])[:, None, None]))
    std = np.full((len(edges), len(Y), len(X), 2), 0.001)
    std[..., 1] = np.where(distance < np.array(edges)[:, None, None], 1.0, 0.001)
    return Deviations(std, X, Y, np.arange(len(edges)))


@pytest.mark.parametrize(("acts", "edge"), [("center", 0.3), ("rim", 0.3 + RADIUS)])
def test_the_distance_to_fog_is_that_to_the_place_where_it_acts(acts: str, edge: float) -> None:
    """By hand, on a line through the centre; obstacles do not count."""
    world = WORLD.model_copy(update={"acts": acts})
    places = np.array([[1.5, 1.0], [1.5 + edge, 1.0], [0.5, 1.0]])
    np.testing.assert_allclose(fog_distance(places, world, RADIUS), [-edge, 0.0, 1.0 - edge], atol=1e-12)


def test_without_fog_every_place_is_infinitely_far_from_it_and_there_is_no_halo() -> None:
    clear = make_world((0.5, 0.5, 0.2, "obstacle"))
    assert np.isinf(fog_distance(np.zeros((2, 3, 2)), clear, RADIUS)).all()
    assert np.isnan(halo(deviations(0.3), clear, RADIUS)).all()


def test_the_halo_is_the_share_of_the_ring_that_is_taken_for_fog() -> None:
    """The areas of rings in closed form, up to the nodes; one coordinate that is uncertain is enough."""
    world = WORLD.model_copy(update={"acts": "center"})
    actual = halo(deviations(0.0, 0.3, 0.325, 0.3 + 2 * WIDTH), world, RADIUS)
    half = (0.325**2 - 0.3**2) / (0.35**2 - 0.3**2)
    np.testing.assert_allclose(actual, [0.0, 0.0, half, 1.0], atol=0.03)


def test_places_farther_away_have_a_share_of_their_own() -> None:
    """Counted node by node: reachable ones beyond the ring."""
    world: Layout = WORLD.model_copy(update={"acts": "center"})
    actual = beyond(deviations(0.3 + WIDTH, 0.6), world, RADIUS)
    x, y = np.meshgrid(X, Y)
    distance = np.hypot(x - 1.5, y - 1.0)
    free = (x > 0.06 - 1e-9) & (x < 2.94 + 1e-9) & (y > 0.06 - 1e-9) & (y < 1.94 + 1e-9)
    free &= np.hypot(x - 0.5, y - 0.5) > 0.26 - 1e-6
    outside = free & (distance > 0.3 + WIDTH)
    np.testing.assert_allclose(actual, [0.0, (distance[outside] < 0.6).mean()], atol=1e-12)
    assert 0.001 < UNCERTAIN < 1.0
