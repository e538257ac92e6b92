"""Scenes: shapes against positions worked out by hand, and what is left out."""

import numpy as np
import pytest

from affmap.env.layout import Layout
from affmap.env.scene import LAYERS, NUM_DEVIATIONS, Mark, Scene, circle_marks

LAYOUT = Layout.load("layout", "original")
PATH = np.array([[0.5, 0.5], [0.6, 0.7]])
SCENE = Scene(LAYOUT, 0.06, np.array([0.4, 0.3]), np.array([2.7, 1.7]), path=PATH, std=np.array([[0.1, 0.2]] * 2))


def marks(scene: Scene, name: str) -> list[Mark]:
    return [mark for mark in scene.marks() if mark.layer == LAYERS[name]]


def test_parts_lie_in_the_order_of_their_layers_above_the_circles() -> None:
    every = SCENE._replace(
        goal_radius=0.1,
        action=np.ones(4),
        candidates=PATH[None],
        times=[PATH],
        way=PATH,
        past=np.array([[0.1, 0.1], [0.4, 0.3]]),
        start=np.array([0.1, 0.1]),
        view=True,
    )
    layers = [mark.layer for mark in every.marks()]
    assert layers[:6] == [mark.layer for mark in circle_marks(LAYOUT)]
    assert list(dict.fromkeys(layers[6:])) == list(LAYERS.values())


def test_little_is_shown_of_a_scene_that_holds_little() -> None:
    bare = SCENE._replace(path=np.full((2, 2), np.nan), std=np.full((2, 2), np.nan))
    assert [mark.layer.label for mark in bare.marks()[6:]] == ["vehicle", "goal", "goal"]


def test_ellipses_are_of_deviations_along_each_axis() -> None:
    for mark, point in zip(marks(SCENE, "uncertainty"), PATH, strict=True):
        assert mark.points == pytest.approx(point[None])
        assert mark.radii == pytest.approx([NUM_DEVIATIONS * 0.1, NUM_DEVIATIONS * 0.2])


def test_a_plan_begins_at_the_vehicle_unless_it_is_lost_in_fog() -> None:
    assert marks(SCENE, "plan")[0].points == pytest.approx(np.array([[0.4, 0.3], *PATH]))
    assert marks(SCENE._replace(in_fog=True), "plan")[0].points == pytest.approx(PATH)


def test_a_jet_leaves_the_rim_opposite_to_where_it_pushes() -> None:
    """The first throttle pushes to the upper right; half open its jet has half its length."""
    (jet,) = marks(SCENE._replace(action=np.array([0.5, 0, 0, 0])), "throttles")
    away = np.array([[0.06], [0.06 + 0.5 * LAYERS["throttles"].size]]) / np.sqrt(2)
    assert jet.points == pytest.approx(SCENE.position - away)


def test_arrows_point_where_fields_pull() -> None:
    """The longest part of the line: up by 0.6 radii from the centre, from as far below."""
    layout = Layout.load("layout", "four_properties")
    (up,) = (circle for circle in layout.circles if circle.effect == "force_up")
    arrows = [mark.points for mark in circle_marks(layout) if mark.radii is None]
    assert any(np.allclose(arrow[:2], [(up.x, up.y + side * 0.6 * up.radius) for side in (-1, 1)]) for arrow in arrows)


def test_on_a_coloured_ground_circles_are_rims_and_paths_have_a_white_one() -> None:
    layers = [mark.layer for mark in SCENE._replace(ground=np.zeros((2, 3, 3))).marks()]
    assert all(layer.width for layer in layers[:12])
    plan = LAYERS["plan"]
    before = layers[layers.index(plan) - 1]
    assert before.color == "#ffffff" and before.width > plan.width


def test_deviations_stay_with_their_points_where_others_are_unknown() -> None:
    """By hand: of three steps the first has no position."""
    path, std = np.vstack([[np.nan, np.nan], PATH]), np.array([[9.0, 9.0], [0.1, 0.2], [0.3, 0.4]])
    first, second = marks(SCENE._replace(path=path, std=std), "uncertainty")
    assert first.points == pytest.approx(PATH[:1]) and second.points == pytest.approx(PATH[1:])
    assert first.radii == pytest.approx(NUM_DEVIATIONS * std[1]) and second.radii == pytest.approx(
        NUM_DEVIATIONS * std[2]
    )
