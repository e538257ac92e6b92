"""The window on a virtual screen: keys, mouse and what is drawn."""

import sys

import numpy as np
import pygame
import pytest

from affmap.env.rendering import WHITE
from affmap.env.scene import LAYERS
from affmap.env.vehicle import VehicleEnv
from affmap.play import window
from affmap.play.game import Game
from affmap.play.window import SCALE, Window


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> Window:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    return Window(Game("exp1"))


def press(shown: Window, *keys: int) -> None:
    for key in keys:
        shown.handle(pygame.event.Event(pygame.KEYDOWN, key=key))


def mouse(shown: Window, kind: int, x: float, y: float) -> None:
    """At a point of the arena, u."""
    place = (round(x * SCALE), round((2 - y) * SCALE))
    shown.handle(pygame.event.Event(kind, pos=place, button=1))


def pixel(shown: Window, x: float, y: float) -> tuple[int, ...]:
    return tuple(shown.screen.get_at((round(x * SCALE), round((2 - y) * SCALE))))[:3]


def test_what_is_drawn_is_where_it_is(shown: Window) -> None:
    """Golden colours at the vehicle, the goal and an obstacle, with the map and without."""
    shown.advance()
    shown.draw()
    for part, place in (("vehicle", shown.game.past[-1]), ("goal", shown.game.env.goal)):
        assert pixel(shown, *place) == tuple(pygame.Color(LAYERS[part].color))[:3]
    assert pixel(shown, 1.5, 1.0) != WHITE
    press(shown, pygame.K_m)
    shown.draw()
    assert pixel(shown, 0.75, 0.5) == pytest.approx([0.85 * 0x8C + 0.15 * 255] * 3, abs=2)


def test_the_map_is_the_right_way_up(shown: Window) -> None:
    """Against the colours of its nodes."""
    press(shown, pygame.K_SPACE)
    shown.draw()
    ground = shown.game.ground
    assert ground is not None
    for x, y in ((1.0, 0.08), (1.0, 1.92), (0.08, 1.2), (2.92, 1.2)):
        node = ground[round(y / 2 * (len(ground) - 1)), round(x / 3 * (ground.shape[1] - 1))]
        np.testing.assert_allclose(np.array(pixel(shown, x, y)) / 255, node, atol=0.15)


def test_the_view_is_the_right_way_up(shown: Window) -> None:
    """In the lower left corner the borders are on the left and below."""
    game = shown.game
    while game.past[-1][0] > 1.5 or game.past[-1][1] > 1.0:
        game.reset()
    left = round(3 * SCALE) + window.MARGIN
    shown.draw()
    top = window.MARGIN + 25 * 10 + 12 + 18
    shade = {place: shown.screen.get_at((left + place[0], top + place[1]))[0] for place in ((3, 106), (106, 3), (3, 3))}
    assert shade[3, 106] == 60, "the corner itself"
    assert shade[106, 3] == 235, "the open side"


def test_keys_change_what_they_say(shown: Window) -> None:
    game = shown.game
    for key, attribute, values in (
        (pygame.K_c, "context_size", [0, 1, 3, 5, 8]),
        (pygame.K_p, "planner", ["gradient", "cem"]),
        (pygame.K_b, "beta", [10.0, 100.0, 0.0, 1.0]),
        (pygame.K_l, "lookup", ["exact", "map"]),
        (pygame.K_g, "guide", ["time_to_go", "none"]),
    ):
        for value in values:
            press(shown, key)
            assert getattr(game.setting, attribute) == value
            shown.advance()
            shown.draw()
    for key, attribute in ((pygame.K_m, "map"), (pygame.K_h, "candidates"), (pygame.K_v, "view")):
        press(shown, key)
        assert not getattr(shown.shown, attribute)
        shown.draw()
    press(shown, pygame.K_w)
    assert game.world == "twelve_obstacles"
    steps = len(game.past)
    press(shown, pygame.K_SPACE)
    shown.advance()
    assert len(game.past) == steps and shown.paused
    press(shown, pygame.K_UP)
    assert game.by_hand
    press(shown, pygame.K_RETURN)
    assert not game.by_hand
    press(shown, pygame.K_r)
    assert len(game.past) == 1
    press(shown, pygame.K_ESCAPE)
    assert not shown.open


def test_a_click_is_a_goal_and_a_drag_moves_a_circle(shown: Window) -> None:
    game = shown.game
    mouse(shown, pygame.MOUSEBUTTONDOWN, 1.5, 1.0)
    mouse(shown, pygame.MOUSEBUTTONUP, 1.5, 1.0)
    np.testing.assert_allclose(game.env.goal, (1.5, 1.0), atol=1 / SCALE)
    mouse(shown, pygame.MOUSEBUTTONDOWN, 0.8, 0.55)  # where it is held
    for x in (0.9, 1.0, 1.1):
        mouse(shown, pygame.MOUSEMOTION, x, 1.05)
    shown.advance()
    assert len(game.past) == 1, "it waits while a circle is held"
    np.testing.assert_allclose(game.layout.circles[0].center, (1.05, 1.0), atol=1 / SCALE)
    mouse(shown, pygame.MOUSEMOTION, 1.2, 1.05)
    mouse(shown, pygame.MOUSEBUTTONUP, 1.2, 1.05)
    mouse(shown, pygame.MOUSEMOTION, 2.0, 1.0)
    shown.advance()
    np.testing.assert_allclose(game.layout.circles[0].center, (1.15, 1.0), atol=1 / SCALE)
    np.testing.assert_allclose(game.env.goal, (1.5, 1.0), atol=1 / SCALE)
    mouse(shown, pygame.MOUSEBUTTONDOWN, 2.25, 0.5)
    mouse(shown, pygame.MOUSEBUTTONUP, 2.25, 0.5)
    np.testing.assert_allclose(game.env.goal, (2.25, 0.5), atol=1 / SCALE)  # in a circle, too
    game.set_goal((1.5, 1.0))
    shown.handle(pygame.event.Event(pygame.MOUSEBUTTONDOWN, pos=(3 * SCALE + 20, 100), button=1))
    np.testing.assert_allclose(game.env.goal, (1.5, 1.0), atol=1 / SCALE)  # the panel is no place to fly to


def test_the_command_opens_a_window_and_closes_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A few frames, then the window's own button."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(sys, "argv", ["affmap-play", "exp4", "--context-size", "8"])
    frames = 0

    def events() -> list[pygame.event.Event]:
        nonlocal frames
        frames += 1
        return [pygame.event.Event(pygame.QUIT)] if frames == 5 else []

    monkeypatch.setattr(pygame.event, "get", events)
    window.main()
    assert frames == 5


def test_the_game_goes_on_when_an_environment_has_closed_its_window(
    shown: Window, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An environment beside it takes the window and closes it, then all of pygame: each time a whole frame."""
    env = VehicleEnv(render_mode="human")
    sizes = []

    def events() -> list[pygame.event.Event]:
        sizes.append(pygame.display.get_window_size())
        return [pygame.event.Event(pygame.QUIT)]

    monkeypatch.setattr(pygame.event, "get", events)
    for disturb in (lambda: env.reset(seed=0), env.close, pygame.quit):
        disturb()
        shown.open = True
        shown.run()
    assert sizes == [(3 * SCALE + window.PANEL, 2 * SCALE + window.FOOT)] * 3


def test_a_mistake_is_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["affmap-play", "exp4", "--world", "mars"])
    with pytest.raises(SystemExit) as leaving:
        window.main()
    assert leaving.value.code == 2 and "conf/layout/mars.yaml does not exist" in capsys.readouterr().err


def test_without_a_screen_that_is_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["affmap-play"])
    monkeypatch.setenv("SDL_VIDEODRIVER", "nothing")
    pygame.display.quit()
    with pytest.raises(SystemExit) as leaving:
        window.main()
    assert leaving.value.code == 2 and "there is no screen to open a window on" in capsys.readouterr().err
