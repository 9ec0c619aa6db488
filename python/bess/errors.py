"""Errors of the package.

Every message names what is wrong, its value with unit, the allowed range and the place, and what to do.
Outcomes that are to be expected (a time limit, an infeasible node) are statuses, not exceptions.
"""

_LONGEST = 2000
"""Characters of a message."""


class BessError(Exception):
    """Base class of everything this package raises on purpose."""


class InputError(BessError, ValueError):
    """Bad input: a file, a parameter, an argument. The command line turns it into exit status 2.

    The message is one line; of a long one, which quotes what somebody wrote, the middle is left out.
    """

    def __init__(self, message: str) -> None:
        line = message.replace("\r", " ").replace("\n", " ")
        if len(line) > _LONGEST:
            line = f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 2 :]}"
        super().__init__(line)


class StoppedEarly(BessError):  # noqa: N818 - an outcome, not a fault
    """A run was interrupted after its results so far were saved. Exit status 3; resume with ``--resume``."""
