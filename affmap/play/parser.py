"""The command line of programs that show agents."""

from affmap.cli import parser
from affmap.control.pretrained import experiments

TRANSITIONS = "such as split of exp6 or split_one_radius of exp6_radii"
"""Examples of transition models, for the help of an option."""


class Parser(parser.Parser):
    """Parser of programs that take a source of agents and a world."""

    def __init__(self, name: str, purpose: str, examples: str) -> None:
        """Begin with the arguments that all of these programs take."""
        super().__init__(name, purpose, examples)
        known = ", ".join(experiments())
        self.add_argument(
            "source", nargs="?", default="exp1", help=f"a report's folder, or one of {known} (default: exp1)"
        )
        self.add_argument("--world", help="a layout of conf/layout (default: that of the experiment)")
