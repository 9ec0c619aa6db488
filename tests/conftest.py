"""What holds for all tests."""

import os
import signal

import pytest

from once import Once

# Background jobs of a shell ignore Ctrl-C, and so do their children; tests send Ctrl-C to theirs.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Once:
    """What several tests look at, made once."""
    folder = tmp_path_factory.getbasetemp()
    return Once(folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder)
