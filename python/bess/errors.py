"""Errors of the package.

Every message names what is wrong, its value with unit, the allowed range and the place, and what to do.
Outcomes that are to be expected (a time limit, an infeasible node) are statuses, not exceptions.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final, Literal

_LONGEST = 2000
"""Characters of a message."""

_on_command_line: ContextVar[bool] = ContextVar("on_command_line", default=False)
_OPTIONS: Final = {"out": ("out=...", "--out"), "resume": ("resume=True", "--resume")}
"""What a message calls an argument: to a caller from Python, and to one of the command line."""


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
    """A run was interrupted after its results so far were saved. Exit status 3; continue with ``resume``."""


def by_reason(problems: Mapping[str, str]) -> list[str]:
    """Return each reason once, as a sentence that begins with the first of the names that share it."""
    names: dict[str, list[str]] = {}
    for name, reason in problems.items():
        names.setdefault(reason, []).append(name)
    return [
        f"{shared[0]}{f' and {len(shared) - 1} more' if len(shared) > 1 else ''}: {reason}"
        for reason, shared in names.items()
    ]


@contextmanager
def command_line(active: bool = True) -> Iterator[None]:
    """Let messages speak of flags, as the command line does; those of workers too if they are told."""
    token = _on_command_line.set(active)
    try:
        yield
    finally:
        _on_command_line.reset(token)


def on_command_line() -> bool:
    """Whether messages speak of flags."""
    return _on_command_line.get()


def option(name: Literal["out", "resume"]) -> str:
    """Return what a message calls an argument: the keyword from Python, the flag on the command line."""
    return _OPTIONS[name][on_command_line()]
