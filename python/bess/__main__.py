"""``python -m bess`` is ``bess``."""

from bess.cli import main

main()
