"""Paints scenes with pygame, in a window or for arrays."""

import numpy as np
import pygame

from affmap.env.scene import Mark, Scene

PIXELS_PER_UNIT = 200

WHITE, BLACK = (255, 255, 255), (0, 0, 0)


def open_window(size: tuple[int, int], title: str) -> pygame.Surface:
    """Open pygame's only window, of `size` in pixels, unless it is open: others may have closed or taken it."""
    window = pygame.display.get_surface()
    if window is None or window.get_size() != size:
        window = pygame.display.set_mode(size)
    if pygame.display.get_caption()[0] != title:
        pygame.display.set_caption(title)
    return window


class Canvas:
    """A picture of a world, drawn anew each time; rows go downward, as pictures do."""

    def __init__(self, size: tuple[float, float], window: bool, pixels_per_unit: int = PIXELS_PER_UNIT) -> None:
        """Prepare pictures of arenas of `size` (u); with `window`, `show` puts them on the screen."""
        self._height, self._scale = size[1], pixels_per_unit
        width, height = (round(length * pixels_per_unit) for length in size)
        self.surface = pygame.Surface((width, height))
        self._clock = pygame.time.Clock() if window else None
        if window:
            open_window((width, height), "affmap")

    def draw(self, scene: Scene) -> None:
        """Draw everything once."""
        if scene.ground is None:
            self.surface.fill(WHITE)
        else:
            pixels = (255 * scene.ground[::-1]).round().astype(np.uint8).transpose(1, 0, 2)  # columns first
            pygame.transform.smoothscale(pygame.surfarray.make_surface(pixels), self.surface.get_size(), self.surface)
        for mark in scene.marks():
            self._mark(mark)
        pygame.draw.rect(self.surface, BLACK, self.surface.get_rect(), width=2)

    def array(self) -> np.ndarray:
        """The picture, `[height, width, 3]` uint8."""
        return np.transpose(pygame.surfarray.array3d(self.surface), (1, 0, 2)).copy()

    def show(self, frames_per_second: int) -> None:
        """Put the picture on the screen and wait for its time to pass."""
        if self._clock is not None:
            open_window(self.surface.get_size(), "affmap").blit(self.surface, (0, 0))
            pygame.event.pump()
            pygame.display.flip()
            self._clock.tick(frames_per_second)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._clock is not None:
            pygame.display.quit()
            self._clock = None

    def _mark(self, mark: Mark) -> None:
        color = pygame.Color(mark.layer.color)
        width = max(1, round(mark.layer.width * self._scale / PIXELS_PER_UNIT)) if mark.layer.width else 0
        pixels = np.rint((mark.points * (1, -1) + (0, self._height)) * self._scale).astype(int).tolist()
        if mark.radii is not None:
            color.a = round(255 * mark.layer.opacity)  # which only a surface of its own blends
            ellipse = pygame.Surface(np.rint(2 * self._scale * mark.radii + width).clip(2).tolist(), pygame.SRCALPHA)
            pygame.draw.ellipse(ellipse, color, ellipse.get_rect(), width)
            self.surface.blit(ellipse, ellipse.get_rect(center=pixels[0]))
        elif width == 1:
            pygame.draw.aalines(self.surface, color, False, pixels)
        elif width:
            pygame.draw.lines(self.surface, color, False, pixels, width)
        else:
            pygame.draw.polygon(self.surface, color, pixels)
