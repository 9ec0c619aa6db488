"""What simulated partners have in common: they listen on the loopback, from one moment to another."""

from __future__ import annotations

from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self

from bess.edge.plant_io.simulated import SimulatedPlant
from bess.errors import InputError


class SimulatedPartner(ABC):
    """Serves a plant at a port of the loopback; a context manager.

    Parameters
    ----------
    plant
        What is behind it.
    port
        0 for any that is free.
    """

    def __init__(self, plant: SimulatedPlant, port: int) -> None:
        self.plant = plant
        self._port = port

    @property
    @abstractmethod
    def address(self) -> str:
        """What ``--plant`` takes."""

    def start(self) -> None:
        """Listen, at the same port as before if it was stopped.

        Raises
        ------
        InputError
            If the port is taken.
        """
        try:
            self._port = self._listen(self._port)
        except (RuntimeError, OSError, TimeoutError) as error:
            self.stop()
            raise InputError(f"port {self._port}: cannot be listened at ({error}); use another") from error

    @abstractmethod
    def stop(self) -> None:
        """Vanish as a computer that is switched off: connections break; plant and watchdog live on."""

    @abstractmethod
    def _listen(self, port: int) -> int:
        """Begin to listen; return the port."""

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()
