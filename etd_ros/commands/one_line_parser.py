"""A command line whose wrong words are said in one line, as all other bad input is."""

from __future__ import annotations

import argparse
from typing import NoReturn

EXIT_BAD_INPUT = 2


class OneLineParser(argparse.ArgumentParser):
    """Says what is wrong and where to look, without the usage of some dozen options; `prog` is what is typed."""

    def error(self, message: str) -> NoReturn:
        """End the process."""
        self.exit(EXIT_BAD_INPUT, f"etd_ros: {message}: `{self.prog} --help` says what there is\n")
