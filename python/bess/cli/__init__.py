"""The command line ``bess``."""

from bess.cli.main import main

__all__ = ["main"]
