from .game import Game as Game
from .render import film as film
from .window import Window as Window
