"""The command line of programs that take flags, and no overrides."""

import re
import sys
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from typing import NoReturn

from affmap.cli.app import VERSION, leave, version
from affmap.settings.messages import nearest


class Parser(ArgumentParser):
    """Parser whose help begins with the purpose, then the usage, and whose errors are a sentence."""

    def __init__(self, name: str, purpose: str, examples: str) -> None:
        """Begin with the flag that all programs take; `examples` are the end of the help, lines that are kept."""
        super().__init__(
            name, epilog=f"examples:\n{examples}", formatter_class=RawDescriptionHelpFormatter, allow_abbrev=False
        )
        self._purpose = f"{name}: {purpose}"
        self.add_argument(VERSION, action="version", version=version(), help="print the versions of affmap and PyTorch")

    def take(self) -> Namespace:
        """Parse the arguments of the process, and leave none for `command`; a mistake ends the process."""
        arguments = self.parse_args()
        sys.argv[1:] = []
        return arguments

    def format_help(self) -> str:
        """The text of `--help`."""
        return f"{self._purpose}\n\n{super().format_help()}"

    def error(self, message: str) -> NoReturn:
        """End the process with one sentence."""
        if unknown := re.match(r"unrecognized arguments: (\S+)", message):
            options = [option for option in self._option_string_actions if option.startswith("--")]
            near = nearest(unknown[1].strip("-"), [option.strip("-") for option in options])
            remedy = f"did you mean --{near}?" if near else f"there are: {', '.join(options)}."
            leave(f"{unknown[1]} is not known here; {remedy}", 2)
        leave(f"{message}.", 2)
