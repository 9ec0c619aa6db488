"""The command line: ``bess run``, ``sweep``, ``report``, ``check``, ``list``."""

from bess.cli.main import main

__all__ = ["main"]
