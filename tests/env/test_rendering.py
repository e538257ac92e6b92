"""Pictures: known places have the known colours, y is upwards, and a window opens and closes."""

import math
from typing import Any

import gymnasium
import numpy as np
import pygame
import pytest

from affmap.env import Layout, VehicleEnv
from affmap.env.effects import EFFECTS
from affmap.env.rendering import WHITE
from affmap.env.scene import LAYERS

START, TARGET = [0.3, 0.25], [2.7, 1.6]

GOAL, PLAN, THROTTLE, VEHICLE = (
    tuple(pygame.Color(LAYERS[name].color))[:3] for name in ("goal", "plan", "throttles", "vehicle")
)


def painted(effect: str, ground: tuple[int, ...] = WHITE) -> tuple[int, ...]:
    """The colour of an effect, as its opacity gives it."""
    opacity = 0.5 if EFFECTS[effect].pull else 0.85
    parts = zip([*pygame.Color(EFFECTS[effect].color)][:3], ground, strict=True)
    return tuple(round(below + opacity * (part - below)) for part, below in parts)


COLORS = {name: painted(name) for name in EFFECTS}


@pytest.fixture(autouse=True)
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


def made(render_mode: str | None = "rgb_array", **arguments: Any) -> VehicleEnv:
    env = VehicleEnv(render_mode=render_mode, **arguments)
    env.reset(seed=0, options={"position": START, "goal": TARGET})
    return env


def picture(env: VehicleEnv) -> np.ndarray:
    found = env.render()
    assert found is not None
    return found


def near(color: tuple[int, ...]) -> Any:
    """A colour, but for how pygame rounds what is not opaque."""
    return pytest.approx(color, abs=1)


def color(frame: np.ndarray, x: float, y: float) -> tuple[int, ...]:
    """Of the pixel at a place in u: 200 pixels a unit, row 0 at the top."""
    return tuple(frame[round((2 - y) * 200), round(x * 200)].tolist())


def test_the_picture_has_200_pixels_a_unit() -> None:
    frame = picture(made())
    assert frame.shape == (400, 600, 3) and frame.dtype == np.uint8


def test_things_are_where_they_are_and_y_is_upwards() -> None:
    """Golden places; the mirrored ones are free."""
    frame = picture(made())
    assert color(frame, *START) == VEHICLE and color(frame, START[0], 2 - START[1]) == WHITE
    assert color(frame, *TARGET) == GOAL and color(frame, TARGET[0], 2 - TARGET[1]) == WHITE
    assert color(frame, 0.75, 0.5) == color(frame, 2.25, 1.5) == near(COLORS["obstacle"])
    assert color(frame, 1.5, 1.0) == WHITE
    assert color(frame, 0, 1) == color(frame, 2.995, 1) == color(frame, 1.5, 2) == color(frame, 1.5, 0.005) == (0, 0, 0)


def test_obstacles_fill_their_circles() -> None:
    """Against distances, on a grid; two pixels at each rim are left to the drawing."""
    env = made()
    frame = picture(env)
    for x in np.arange(0.5, 2.5, 0.05):
        for y in np.arange(0.1, 1.9, 0.05):
            gap = min(math.hypot(x - one.center[0], y - one.center[1]) - one.radius for one in env.layout.circles)
            if abs(gap) > 0.01:
                assert color(frame, x, y) == near(COLORS["obstacle"] if gap < 0 else WHITE), (x, y)


def test_each_effect_has_its_colour_and_obstacles_lie_on_top() -> None:
    circles = [
        {"center": [0.4 * number + 0.3, 1.0], "radius": 0.2, "effect": effect, "channel": "solid"}
        for number, effect in enumerate(COLORS)
    ]
    circles.append({"center": [2.7, 1.0], "radius": 0.3, "effect": "fog", "channel": "solid"})
    frame = picture(made(layout=Layout.load("layout", "original", circles=circles)))
    for number, effect in enumerate([*COLORS][:-1]):
        assert color(frame, 0.4 * number + 0.33, 1.0) == near(COLORS[effect]), "beside arrows"
    assert color(frame, 2.95, 1.0) == near(COLORS["fog"])
    assert color(frame, 2.7, 1.0) == near(painted("obstacle", COLORS["fog"]))
    assert len({*COLORS.values(), WHITE, VEHICLE, GOAL, PLAN, THROTTLE}) == 12


def test_the_vehicle_has_its_radius_and_moves_with_its_position() -> None:
    """Area of the disc within 5 %; after flying, it is drawn at the true position."""
    env = made()
    size = (picture(env) == VEHICLE).all(-1).sum()
    assert size == pytest.approx(math.pi * (0.06 * 200) ** 2, rel=0.05)
    for _ in range(15):
        *_, info = env.step(np.array([0.0, 1, 0, 0]))
    frame = picture(env)
    assert color(frame, *info["position"]) == VEHICLE and color(frame, *START) != VEHICLE


@pytest.mark.parametrize("throttle", range(4))
def test_a_jet_leaves_opposite_to_where_it_pushes(throttle: int) -> None:
    """Golden directions: 0 pushes to the upper right, so its jet is at the lower left; and so on around."""
    env = VehicleEnv(render_mode="rgb_array")
    env.reset(seed=0, options={"position": [1.12, 1.0], "goal": TARGET})
    *_, info = env.step(np.eye(4)[throttle])
    frame = picture(env)
    jets = []
    for pushes in ([1, 1], [-1, 1], [-1, -1], [1, -1]):
        place = info["position"] - np.array(pushes) / math.sqrt(2) * 0.1
        jets.append(color(frame, *place) == THROTTLE)
    assert jets == [number == throttle for number in range(4)]


def test_a_planned_path_is_drawn_when_given() -> None:
    """At its points, and on the way to the first of them; without it these places are free."""
    env = made()
    points = np.array([[0.3, 0.6], [0.3, 1.0], [1.2, 1.0]])
    places = [*points.tolist(), [0.3, 0.45], [0.75, 1.0]]
    assert [color(picture(env), *place) for place in places] == [WHITE] * 5
    env.planned_positions = points
    assert [color(picture(env), *place) for place in places] == [PLAN] * 5
    env.planned_positions = None
    assert [color(picture(env), *place) for place in places] == [WHITE] * 5


def test_a_picture_is_the_caller_s_own() -> None:
    """Writing into it changes no later one; drawing twice gives equal pictures."""
    env = made()
    first = picture(env)
    kept = first.copy()
    first[:] = 0
    np.testing.assert_array_equal(picture(env), kept)


def on_screen() -> np.ndarray:
    """The picture in the window."""
    surface = pygame.display.get_surface()
    assert surface is not None
    return pygame.surfarray.array3d(surface).transpose(1, 0, 2)


def test_the_window_shows_the_same_picture_and_closes() -> None:
    """Against "rgb_array", after reset and after a step, without a call of `render`."""
    env, reference = made("human"), made()
    assert pygame.display.get_init()
    for _ in range(2):
        np.testing.assert_array_equal(on_screen(), picture(reference))
        for one in (env, reference):
            one.step(np.array([1.0, 0.5, 0, 0]))
    assert env.render() is None
    env.close()
    assert not pygame.display.get_init()
    env.close()


def test_an_environment_flies_on_when_another_one_s_window_closes() -> None:
    """Two of other sizes, one of Gymnasium's own, and all of pygame: the next step opens the window again."""
    small = Layout.load("layout", "original", size=(2.0, 1.0), circles=[])
    env, reference, other = made("human"), made(), VehicleEnv(small, render_mode="human")
    cart = gymnasium.make("CartPole-v1", render_mode="human")
    for one in (other, cart):
        one.reset(seed=0)
    for close in (other.close, cart.close, pygame.quit, lambda: other.step(np.zeros(4))):
        close()
        for one in (env, reference):
            one.step(np.array([1.0, 0.5, 0, 0]))
        np.testing.assert_array_equal(on_screen(), picture(reference))
        assert pygame.display.get_caption()[0] == "affmap"
    env.close()
    other.step(np.zeros(4))
    assert on_screen().shape == (200, 400, 3)
    other.close()


def test_without_a_mode_render_warns_and_gives_nothing() -> None:
    env = made(None)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None
