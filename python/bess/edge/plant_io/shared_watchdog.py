"""What a plant may still hold whose one watchdog is fed by the writes to any of its strings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping


class SharedWatchdog:
    """Keeps in mind which strings may have a set-point at the plant that nobody can change any more.

    Writes to the other strings would keep such a set-point alive for ever. Once a string has refused to be
    written for ``patience_s`` while others were, nothing is written until the watchdog must have acted; then
    the plant holds nothing of that string, and the others go on without it.

    Parameters
    ----------
    patience_s
        How long a string may refuse.
    forgets_s
        Time without any write after which the plant holds no set-point.
    clock
        Seconds; never goes back.
    """

    def __init__(self, patience_s: float, forgets_s: float, clock: Callable[[], float]) -> None:
        self._patience_s, self._forgets_s, self._clock = patience_s, forgets_s, clock
        self._may_hold: set[str] | None = None
        self._refuses_since: dict[str, float] = {}
        self._fed_at_s = clock()

    def may_hold(self, name: str) -> bool:
        """Whether the plant may have a set-point for this string; before the first writes it may for any."""
        return self._may_hold is None or name in self._may_hold

    def wait_s(self) -> tuple[list[str], float]:
        """Return the strings that refuse, and how long nothing may be written for their sake."""
        now = self._clock()
        if now - self._fed_at_s >= self._forgets_s:
            self._may_hold, self._refuses_since = set(), {}
        stuck = [name for name, since in self._refuses_since.items() if now - since >= self._patience_s]
        return stuck, self._fed_at_s + self._forgets_s - now if stuck else 0.0

    def note(self, written: Mapping[str, bool], unknown: Iterable[str], refused: Iterable[str]) -> None:
        """Take down the outcome of one round of writes.

        Parameters
        ----------
        written
            Strings that were written, and whether they have a set-point now.
        unknown
            Strings whose write may have arrived or not.
        refused
            Strings whose write the plant refused.
        """
        failed = {name for name in refused if self.may_hold(name)} | set(unknown)
        kept = set() if self._may_hold is None else self._may_hold - written.keys()
        self._may_hold = kept | failed | {name for name, holds in written.items() if holds}
        for name in written:
            self._refuses_since.pop(name, None)
        if written:
            self._fed_at_s = self._clock()
            for name in failed:
                self._refuses_since.setdefault(name, self._fed_at_s)
