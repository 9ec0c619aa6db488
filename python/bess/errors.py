"""Errors of the package.

Every message gives the problem, the value with its unit, the allowed range, the place and the remedy.
Expected outcomes (a time limit, an infeasible node) are statuses, not exceptions.
"""

import difflib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager

_MAX_LENGTH = 2000
"""Characters of a message."""
_MAX_NAMES = 20
_MAX_NAME_LENGTH = 60


class BessError(Exception):
    """Base class of all exceptions of this package."""


class InputError(BessError, ValueError):
    """Invalid input: a file, a parameter or an argument. Exit status 2 on the command line.

    The message is one line; the middle of a very long message is omitted.
    """

    def __init__(self, message: str) -> None:
        line = message.replace("\r", " ").replace("\n", " ")
        if len(line) > _MAX_LENGTH:
            line = f"{line[: _MAX_LENGTH // 2]} ... {line[-_MAX_LENGTH // 2 :]}"
        super().__init__(line)


class StoppedEarly(BessError):  # noqa: N818 - an outcome, not a fault
    """A run was interrupted after its results so far were saved. Exit status 3; continue with ``resume``."""


@contextmanager
def placed(place: str) -> Iterator[None]:
    """Begin the message of an :class:`InputError` with its place, such as the name of a run, if given."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {error}" if place else str(error)) from error


def nearest(name: str, allowed: Iterable[str], prefix: str = "") -> str:
    """Return the remedy for an unknown name: the most similar allowed name (after ``prefix``), or all."""
    names = list(allowed)
    close = difflib.get_close_matches(name, names, 1)
    return f"did you mean {prefix + close[0]!r}?" if close else f"allowed: {', '.join(names)}"


def listed(names: Iterable[str]) -> str:
    """Return names for a message: all of a short list, the first of a long one."""
    texts = [name if len(name) <= _MAX_NAME_LENGTH else f"{name[:_MAX_NAME_LENGTH]}..." for name in names]
    more = len(texts) - _MAX_NAMES
    return ", ".join(texts[:_MAX_NAMES]) + (f" and {more} more" if more > 0 else "") or "(none)"


def by_reason(problems: Mapping[str, str]) -> list[str]:
    """Return each distinct reason once, with the first name it applies to and the number of others."""
    names: dict[str, list[str]] = {}
    for name, reason in problems.items():
        names.setdefault(reason, []).append(name)
    return [
        f"{shared[0]}{f' and {len(shared) - 1} more' if len(shared) > 1 else ''}: {reason}"
        for reason, shared in names.items()
    ]
