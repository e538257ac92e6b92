from .app import command as command
from .app import read_sweep as read_sweep
