"""The command `affmap-play`: the game in a window (pygame), with a panel on the agent and its view."""

import os
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
import pygame
import torch

from affmap.cli.app import command
from affmap.control.settings import GUIDES
from affmap.env.body import THROTTLES
from affmap.env.rendering import BLACK, WHITE, Canvas, open_window
from affmap.env.scene import Scene
from affmap.env.vehicle import RENDER_FPS
from affmap.play.game import BETAS, LOOKUPS, Game
from affmap.play.parser import TRANSITIONS, Parser
from affmap.results.setting import PLANNERS
from affmap.settings import ConfigError

SCALE = 300  # pixels a unit
PANEL, MARGIN, FOOT = 330, 14, 34  # pixels
GREY, POSITIVE, NEGATIVE = (110, 110, 110), (0, 114, 178), (213, 94, 0)

ARROWS = {
    pygame.K_RIGHT: (1, 0),
    pygame.K_LEFT: (-1, 0),
    pygame.K_UP: (0, 1),
    pygame.K_DOWN: (0, -1),
}
"""Key -> direction of the push."""

HELP = "click: goal   drag a circle: move it   arrows: fly by hand   enter: the agent flies   space: pause   R: restart"


T = TypeVar("T")


class Held(NamedTuple):
    """A circle under the mouse; lengths in u."""

    number: int
    grip: np.ndarray
    """Offset `[2]` from the grip to the centre."""
    now: tuple[float, float]
    """Position of the mouse."""
    moved: bool = False


class Shown(NamedTuple):
    """Switches for the parts of the picture besides the vehicle and its layout."""

    candidates: bool = True
    map: bool = True
    view: bool = True


class Window:
    """Window that displays a game and takes the player's input."""

    def __init__(self, game: Game) -> None:
        """Open a window.

        Raises:
            ConfigError: there is no screen.
        """
        self.game, self.shown = game, Shown()
        self.paused, self.open = False, True
        self._held: Held | None = None
        find_screen()
        self._fit()
        self._clock = pygame.time.Clock()

    def _fit(self) -> None:
        """Give the window the size of the world."""
        game = self.game
        self._canvas = Canvas(game.layout.size, window=False, pixels_per_unit=SCALE)
        self._open()

    def _open(self) -> None:
        """Open the window, unless it is there; an environment that is closed takes it and the fonts with it."""
        width, height = self._canvas.surface.get_size()
        self.screen = open_window((width + PANEL, height + FOOT), f"affmap: {self.game.source}")
        pygame.font.init()
        self._font, self._small = pygame.font.Font(None, 22), pygame.font.Font(None, 19)

    def run(self) -> None:
        """Play until the window is closed."""
        while self.open:
            self._open()
            for event in pygame.event.get():
                self.handle(event)
            self.advance()
            self.draw()
            pygame.display.flip()
            self._clock.tick(RENDER_FPS)
        pygame.display.quit()

    def handle(self, event: pygame.event.Event) -> None:
        """React to the player."""
        if event.type == pygame.QUIT:
            self.open = False
        elif event.type == pygame.KEYDOWN:
            self._press(event.key)
        elif event.type == pygame.MOUSEBUTTONDOWN and event.button == 1 and self._in_arena(event.pos):
            point = self._point(event.pos)
            number = self.game.circle_at(point)
            if number is None:
                self.game.set_goal(point)
            else:
                grip = np.subtract(self.game.layout.circles[number].center, point)
                self._held = Held(number, grip, self._point(event.pos))
        elif event.type == pygame.MOUSEMOTION and self._held is not None:
            self._held = self._held._replace(now=self._point(event.pos), moved=True)
        elif event.type == pygame.MOUSEBUTTONUP and event.button == 1 and self._held is not None:
            self._move()
            if not self._held.moved:  # a click
                self.game.set_goal(self._held.now)
            self._held = None

    def _move(self) -> None:
        """Move the held circle with the mouse."""
        if self._held is not None and self._held.moved:
            self.game.move_circle(self._held.number, (self._held.grip + self._held.now).tolist())

    def _press(self, key: int) -> None:
        game, setting = self.game, self.game.setting
        if key in (pygame.K_ESCAPE, pygame.K_q):
            self.open = False
        elif key in ARROWS:
            game.by_hand = True
        elif key == pygame.K_RETURN:
            game.by_hand = False
        elif key == pygame.K_SPACE:
            self.paused = not self.paused
        elif key == pygame.K_r:
            game.reset()
        elif key == pygame.K_w:
            game.enter(_next(game.worlds, game.world))
            self._fit()
        elif key == pygame.K_c:
            game.change(context_size=_next(game.origin.context_sizes, setting.context_size))
        elif key == pygame.K_p:
            game.change(planner=_next(game.planners, setting.planner))
        elif key == pygame.K_b:
            game.change(beta=_next(BETAS, setting.beta))
        elif key == pygame.K_l:
            game.change(lookup=_next(LOOKUPS, setting.lookup))
        elif key == pygame.K_g:
            game.change(guide=_next(GUIDES, setting.guide))
        elif key == pygame.K_h:
            self.shown = self.shown._replace(candidates=not self.shown.candidates)
        elif key == pygame.K_m:
            self.shown = self.shown._replace(map=not self.shown.map)
        elif key == pygame.K_v:
            self.shown = self.shown._replace(view=not self.shown.view)

    def advance(self) -> None:
        """Fly for a step, unless the game is paused or a circle is held."""
        pressed = pygame.key.get_pressed()
        direction = np.sum([push for key, push in ARROWS.items() if pressed[key]] or [(0, 0)], axis=0)
        self.game.throttles = (THROTTLES @ direction > 1e-6).astype(float)
        self._move()  # once a frame, however often the mouse has moved
        self.game.step(self.paused or self._held is not None)

    def draw(self) -> None:
        """Draw everything."""
        game, env, thought = self.game, self.game.env, self.game.thought
        self.screen.fill(WHITE)
        canvas = self._canvas
        scene = Scene(env.layout, env.vehicle.radius, game.past[-1], env.goal, env.goal_radius, env.action)
        ground = game.ground if self.shown.map else None
        scene = scene._replace(past=np.array(game.past[-200:]), in_fog=game.in_fog, view=self.shown.view, ground=ground)
        scene = scene._replace(way=game.way, times=game.times)
        if thought:
            scene = scene._replace(path=thought.path, std=thought.std)
            scene = scene._replace(candidates=thought.candidates if self.shown.candidates else None)
        canvas.draw(scene)
        self.screen.blit(canvas.surface, (0, 0))
        self._panel(canvas.surface.get_width() + MARGIN)
        foot = canvas.surface.get_height() + FOOT // 3
        self._text(game.message or HELP, (MARGIN, foot), NEGATIVE if game.message else GREY, self._small)

    def _panel(self, left: int) -> None:
        game, setting = self.game, self.game.setting
        planner = PLANNERS[setting.planner].method if setting.planner in PLANNERS else setting.planner
        pilot = "by hand" if game.by_hand else "by the agent"
        state = "paused" if self.paused else f"flown {pilot}"
        lines = [
            f"{state}, {game.distance:.2f} u to the goal",
            f"C   context code: {setting.context_size or 'none'}",
            f"P   planner: {planner}",
            f"B   beta, weight on uncertainty: {setting.beta:g}",
            f"L   look-up: {'affordance map' if setting.lookup == 'map' else 'exact'}",
            f"G   guide: {'time to go' if setting.guide == 'time_to_go' else 'none, straight to the goal'}",
            f"W   world: {game.world}",
            f"M   map in colours: {_on(self.shown.map) if setting.context_size else 'there is none'}",
            f"H   candidates: {_on(self.shown.candidates)}",
            f"V   view: {_on(self.shown.view)}",
        ]
        for number, line in enumerate(lines):
            self._text(line, (left, MARGIN + 25 * number), BLACK, self._font)
        top = MARGIN + 25 * len(lines) + 12
        if self.shown.view:
            top = self._view(left, top)
        if setting.context_size:
            self._bars(left, top)

    def _view(self, left: int, top: int) -> int:
        """Draw a tile for each channel, side by side; returns the top of the next part."""
        view, names = self.game.view, self.game.layout.channels
        self._text("view of the vehicle", (left, top), GREY, self._small)
        side = min(110, (PANEL - 2 * MARGIN) // len(names) - 6)
        for number, (channel, name) in enumerate(zip(view, names, strict=True)):
            shades = np.where(channel[::-1].T, 60, 235).astype(np.uint8)
            tile = pygame.surfarray.make_surface(np.repeat(shades[..., None], 3, axis=2))
            place = (left + number * (side + 6), top + 18)
            self.screen.blit(pygame.transform.scale(tile, (side, side)), place)
            self._text(name, (place[0], place[1] + side + 3), GREY, self._small)
        return top + side + 50

    def _bars(self, left: int, top: int) -> None:
        """Draw the context code at the vehicle's position."""
        code = self.game.code
        self._text("context code there", (left, top), GREY, self._small)
        middle, half = left + 130, 90
        longest = max(0.2, float(np.abs(code).max()))
        for number, value in enumerate(code):
            row = top + 22 + min(20, 170 // len(code)) * number
            width = round(half * float(value) / longest)
            bar = pygame.Rect(min(middle, middle + width), row, max(1, abs(width)), max(3, min(14, 140 // len(code))))
            pygame.draw.rect(self.screen, POSITIVE if value > 0 else NEGATIVE, bar)
            if len(code) <= 8:
                self._text(f"{value:+.2f}".replace("-", "−"), (left, row - 1), BLACK, self._small)
        pygame.draw.line(self.screen, GREY, (middle, top + 18), (middle, top + 24 + 170), 1)

    def _text(self, text: str, place: tuple[int, int], color: tuple[int, int, int], font: pygame.font.Font) -> None:
        self.screen.blit(font.render(text, True, color), place)

    def _point(self, pixel: tuple[int, int]) -> tuple[float, float]:
        """Point of the arena under a pixel, u."""
        return pixel[0] / SCALE, self.game.layout.size[1] - pixel[1] / SCALE

    def _in_arena(self, pixel: tuple[int, int]) -> bool:
        (x, y), (width, height) = self._point(pixel), self.game.layout.size
        return 0 <= x <= width and 0 <= y <= height


def find_screen() -> None:
    """Check that there is a screen for a window.

    Raises:
        ConfigError: there is no screen.
    """
    try:
        pygame.display.init()
    except pygame.error as error:
        raise ConfigError(f"there is no screen to open a window on ({error}).") from None
    if pygame.display.get_driver() in ("dummy", "offscreen") and "SDL_VIDEODRIVER" not in os.environ:
        raise ConfigError(
            "there is no screen to open a window on; affmap-render and affmap-learn make films without one."
        )


def _next(options: Sequence[T], now: T) -> T:
    """Option after the present one; the first if the present one is not an option."""
    return options[(options.index(now) + 1) % len(options)] if now in options else options[0]


def _on(shown: bool) -> str:
    return "shown" if shown else "hidden"


def main() -> None:
    """Run the command `affmap-play`."""
    purpose = "fly the vehicle, or watch a trained agent imagine and fly."
    examples = (
        "  affmap-play\n  affmap-play exp1 --world two_obstacles\n  affmap-play runs/exp1 --context-size 8\n"
        "  affmap-play exp6 --transition split --world pairs_and_triples"
    )
    parser = Parser("affmap-play", purpose, examples)
    parser.add_argument("--context-size", type=int, help="units of the context code (default: the most there are)")
    parser.add_argument("--transition", help=f"the transition model, {TRANSITIONS} (default: the first there is)")
    arguments = parser.take()
    torch.set_num_threads(1)  # a step is many small operations; more threads wait for each other
    given = arguments.source, arguments.world, arguments.context_size, arguments.transition
    command(lambda _: Window(Game(*given)).run(), resumes=False)
