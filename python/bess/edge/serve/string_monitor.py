"""Monitoring of one string: each check of its readings is one sentence, or none."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final, Literal

import numpy as np

from bess.arrays import Array
from bess.checkpoints import Checkpointed
from bess.display import rounded
from bess.edge.plant_io import Measurements
from bess.study.sections import ServiceSection
from bess.system import System

MAX_READING_C: Final = 90.0
MIN_READING_C: Final = -40.0
"""A sensor is faulty outside this range."""
SOC_SLACK: Final = 0.03
"""Permitted deviation of a reading from its expected value, for errors of an intact sensor."""
MAX_COOLING_C_PER_S: Final = 0.2
TEMPERATURE_SLACK_K: Final = 5.0
CONSISTENT_READINGS: Final = 3
"""Number of consistent readings after a jump until they are accepted."""
MAX_SOC_RESOLUTION: Final = 0.01
MIN_SOC_RESOLUTION: Final = 0.001
"""Resolution of SOC readings: one per cent until a smaller change is observed."""
FOLLOWS_WITHIN: Final = 0.1
"""Permitted deviation of a string from its set-point, as a share of nominal power."""
NOT_FOLLOWING: Final = 2
"""Number of consecutive readings off the set-point."""
READ_BACK_WITHIN: Final = 0.02
"""Permitted rounding of a set-point by a device, as a share of nominal power."""
RECENT_SETPOINTS: Final = 6
"""Number of recent set-points; the power of a string in transition is between them."""


Trouble = Literal["power", "soc", "all", "other"]
"""Power that is implausible or off its set-point, constant SOC, constant readings of all kinds, or another
controller that writes."""


@dataclass
class Outage:
    """Why and for how long a string is not used, or only up to ``cap_kw``."""

    trouble: Trouble
    reason: str
    until_s: float
    """Duration until the next try [s]; with another controller, of rest."""
    cap_kw: float
    gone_s: float = 0.0
    rest_s: float = 0.0

    def finding(self) -> tuple[str, float]:
        """Return reason and limit [kW]."""
        if self.trouble == "other":
            return self.reason, self.cap_kw
        left_s = max(0.0, self.until_s - self.gone_s)
        return f"{self.reason}; tried again in {left_s:.0f} s", self.cap_kw


class StringMonitor(Checkpointed):
    """Monitors one string; each check returns a reason, and the limit of its power."""

    _carried = (
        "soc", "temperature_c", "other_soc", "agreeing", "unchanged", "moved", "resolution", "last_reading",
        "last_power_kw", "flow_kw", "flow_s", "was_out", "missing_s", "off_target", "on_target", "tries",
        "asked_kw", "outage",
    )  # fmt: skip
    _classes: ClassVar = {"outage": Outage}

    def __init__(self, system: System, string: int, service: ServiceSection, step_s: float) -> None:
        battery = system.strings[string].battery
        self._i, self._service, self._step_s = string, service, step_s
        self._nominal_kw, self._window = float(system.nominal_kw[string]), (battery.soc_min, battery.soc_max)
        self._max_kw = (1.0 + FOLLOWS_WITHIN) * self._nominal_kw
        self.soc: float | None = None
        self.temperature_c: float | None = None
        self.other_soc: float | None = None
        self.agreeing = 0
        self.resolution = MAX_SOC_RESOLUTION
        self.last_reading: float | None = None
        self.last_power_kw: float | None = None
        self.flow_kw = self.flow_s = self.missing_s = 0.0
        self.was_out = False
        self.on_target = self.tries = 0
        self.asked_kw: list[float] = []
        self._put_back()

    def _put_back(self) -> None:
        """Put the string back into service, as at the start."""
        self.outage: Outage | None = None
        self.off_target = self.unchanged = 0
        self.moved = 0.0

    @property
    def trouble(self) -> Trouble | None:
        """Why the string is not, or only partly, used."""
        return None if self.outage is None else self.outage.trouble

    def possible_soc(self) -> Array:
        """SOC, and the smaller and the larger of its possible values, within the window."""
        values = [v for v in (self.soc, self.other_soc) if v is not None] or [0.5]
        return np.clip([values[0], min(values), max(values)], *self._window)

    def flow_kw_of(self, measured: Measurements, elapsed_s: float, *, out: bool) -> float:
        """Last known power of a string out of service, until its watchdog must have acted.

        A constant value after that may be that of a lost device. A string that has just been taken out of
        service stops when its set-point is cleared, unless it cannot be reached.
        """
        power_kw = float(measured.power_kw[self._i])
        is_new = abs(power_kw) <= self._max_kw and (power_kw != self.flow_kw or not out)
        self.flow_s = 0.0 if is_new else self.flow_s + elapsed_s
        self.flow_kw = power_kw if is_new else self.flow_kw
        is_lost = self.trouble == "all" or (measured.available[self._i] and not self.was_out)
        self.was_out = out
        return 0.0 if not out or is_lost or self.flow_s > self._service.watchdog_s else self.flow_kw

    def judge(
        self, measured: Measurements, asked_kw: float, elapsed_s: float, energy_kwh: float, drives: bool
    ) -> tuple[str, float]:
        """Check the readings of the string; return a reason, or none, and its limit [kW], 0 if it is out."""
        i = self._i
        power, soc, temperature = (
            float(values[i]) for values in (measured.power_kw, measured.soc, measured.temperature_c)
        )
        carried = power if abs(power) <= self._max_kw else asked_kw
        expected = -carried * elapsed_s / 3600.0 / energy_kwh
        if not measured.available[i]:
            self._put_back()
            if 0.0 <= soc <= 1.0:
                self._accept_soc(soc)
            remark = measured.remarks[i] if measured.remarks else ""
            return remark or "out of service, says the plant", 0.0
        if unusable := self._unusable(soc, temperature, expected, elapsed_s):
            return unusable
        soc = min(max(soc, 0.0), 1.0)
        doubt = self._take_soc(soc, expected, elapsed_s, energy_kwh)
        doubt = self._take_temperature(temperature, elapsed_s) or doubt
        same_power = self.last_power_kw is not None and power == self.last_power_kw
        self.last_power_kw = power if np.isfinite(power) else None
        held_kw = np.nan if measured.setpoint_kw is None else float(measured.setpoint_kw[i])
        if self.outage is not None:
            moves = soc != self.last_reading or (self.outage.trouble == "all" and not same_power)
            if not self._is_over(self.outage, moves, power, held_kw, elapsed_s):
                return self.outage.finding()
            self._put_back()
            self.last_reading = soc
            return "", math.inf
        stood = f"its state of charge has been constant at {100.0 * soc:.4g} %"
        if self._is_frozen(soc, abs(expected)):
            sentence = f"{stood} for {self.unchanged} readings while it carried power"
            return self._take_out("soc", sentence)
        self.last_reading = soc
        if self._max_kw < abs(power) < np.inf:
            beyond = f"its power of {rounded(power, 4)} kW is implausible"
            sentence = f"{beyond}, its inverter has {rounded(self._nominal_kw, 4)} kW"
            return self._take_out("power", sentence)
        if drives and (sentence := self._other_writer(power, held_kw, asked_kw)):
            return self._take_out("other", sentence)
        if np.isfinite(power) and (sentence := self._does_not_follow(power, asked_kw)):
            if same_power and power != 0.0 and self.unchanged >= NOT_FOLLOWING:
                # It may follow; its reported values are frozen.
                sentence = f"{stood} and its power at {rounded(power, 4)} kW, for any set-point"
                return self._take_out("all", sentence)
            same_way = power * asked_kw > 0.0 and abs(power) < abs(asked_kw)
            return self._take_out("power", sentence, abs(power) if same_way else 0.0)
        return doubt, math.inf

    def _unusable(
        self, soc: float, temperature_c: float, expected: float, elapsed_s: float
    ) -> tuple[str, float] | None:
        """Judge readings that are missing or implausible; None if both can be used."""
        if not np.isfinite(soc):
            self.missing_s += elapsed_s
            if self.soc is None or self.missing_s > self._service.late_after_s:
                return "its state of charge is missing", 0.0
            self.soc = min(max(self.soc + expected, 0.0), 1.0)
            limit_kw = math.inf if self.outage is None else self.outage.cap_kw
            return f"its state of charge is missing for {self.missing_s:.0f} s and estimated", limit_kw
        self.missing_s = 0.0
        if not -0.005 <= soc <= 1.005:
            return f"its state of charge of {100.0 * soc:.4g} % is implausible", 0.0
        if np.isfinite(temperature_c) and not MIN_READING_C <= temperature_c <= MAX_READING_C:
            return f"its temperature of {temperature_c:.4g} °C is implausible", 0.0
        return None

    def _take_soc(self, soc: float, expected: float, elapsed_s: float, energy_kwh: float) -> str:
        """Accept a plausible reading; after a jump, keep both values until readings agree."""
        span_s = max(elapsed_s, self._step_s)
        reach = SOC_SLACK + 1.2 * self._nominal_kw * span_s / 3600.0 / energy_kwh
        before = self.soc
        if before is None or abs(soc - before - expected) <= reach:
            if before is not None and 0.0 < abs(soc - before) < self.resolution:
                self.resolution = max(abs(soc - before), MIN_SOC_RESOLUTION)
            self._accept_soc(soc)
            return ""
        agrees = self.other_soc is not None and abs(soc - self.other_soc - expected) <= reach
        self.agreeing = self.agreeing + 1 if agrees else 1
        jump = f"its state of charge jumped from {100.0 * before:.4g} % to {100.0 * soc:.4g} %"
        if self.agreeing >= CONSISTENT_READINGS:
            self._accept_soc(soc)
            return f"{jump} and stays"
        self.soc = min(max(before + expected, 0.0), 1.0)
        self.other_soc = soc
        return f"{jump}; the more conservative of both values applies"

    def _accept_soc(self, soc: float) -> None:
        self.soc, self.other_soc, self.agreeing = soc, None, 0

    def _take_temperature(self, temperature_c: float, elapsed_s: float) -> str:
        before = self.temperature_c
        if not np.isfinite(temperature_c):
            return "its temperature is unknown" if before is None else ""
        reach = TEMPERATURE_SLACK_K + MAX_COOLING_C_PER_S * max(elapsed_s, self._step_s)
        if before is None or before - temperature_c <= reach:
            # A sudden rise is accepted at once, which is safe.
            self.temperature_c = temperature_c
            return ""
        self.temperature_c = before - reach
        return (
            f"its temperature fell from {before:.4g} °C to {temperature_c:.4g} °C at once, implausibly fast"
        )

    def _is_frozen(self, soc: float, moved: float) -> bool:
        if self.last_reading is None or soc != self.last_reading:
            self.unchanged, self.moved = 0, 0.0
            return False
        self.unchanged += 1
        self.moved += moved
        return self.unchanged >= self._service.frozen_readings and self.moved >= 2.0 * self.resolution

    def _does_not_follow(self, power_kw: float, asked_kw: float) -> str:
        off = abs(power_kw - asked_kw) > FOLLOWS_WITHIN * self._nominal_kw
        self.off_target = self.off_target + 1 if off else 0
        self.on_target = 0 if off or not asked_kw else self.on_target + 1
        if self.on_target >= self._service.frozen_readings:
            self.tries = 0
        return "" if self.off_target < NOT_FOLLOWING else _off(asked_kw, power_kw)

    def _other_writer(self, power_kw: float, held_kw: float, asked_kw: float) -> str:
        """Return a sentence if set-point or power of the string differ from all recent set-points.

        A string that ramps or limits its power is between its last set-points and zero.
        """
        self.asked_kw = [*self.asked_kw, asked_kw][-RECENT_SETPOINTS:]
        who = f"another controller writes to string {self._i}"
        # A device that has restarted holds zero.
        if min(abs(held_kw), abs(held_kw - asked_kw)) > READ_BACK_WITHIN * self._nominal_kw:
            return f"{who}: set-point read back {rounded(held_kw, 4)} kW, commanded {rounded(asked_kw, 4)} kW"
        slack_kw = FOLLOWS_WITHIN * self._nominal_kw
        low_kw, high_kw = min(0.0, *self.asked_kw) - slack_kw, max(0.0, *self.asked_kw) + slack_kw
        if low_kw <= power_kw <= high_kw or not np.isfinite(power_kw) or self.off_target + 1 < NOT_FOLLOWING:
            return ""
        return f"{who}, or it hangs; {_off(asked_kw, power_kw)}"

    def _is_over(
        self, outage: Outage, moves: bool, power_kw: float, held_kw: float, elapsed_s: float
    ) -> bool:
        """Whether a string is tried again: after a while, or at once if a frozen reading ``moves`` again.

        With another controller, the string must have been at rest for a while: one of two controllers gives
        way. A plant that does not report set-points may keep the last one of a controller that has stopped.
        The string is therefore tried again at increasing intervals.
        """
        outage.gone_s += elapsed_s
        if outage.trouble != "other":
            return (outage.trouble != "power" and moves) or outage.gone_s >= outage.until_s
        rests = abs(np.nan_to_num(power_kw)) <= FOLLOWS_WITHIN * self._nominal_kw
        rests &= not abs(held_kw) > READ_BACK_WITHIN * self._nominal_kw
        outage.rest_s = outage.rest_s + elapsed_s if rests else 0.0
        patience_s = self._service.retry_after_s * 2.0 ** min(self.tries, 30)
        may_be_left = not np.isfinite(held_kw) and outage.gone_s >= patience_s
        return outage.rest_s >= outage.until_s or may_be_left

    def _take_out(self, trouble: Trouble, reason: str, cap_kw: float = 0.0) -> tuple[str, float]:
        until_s = self._service.retry_after_s
        if trouble in ("power", "other"):  # tried again soon, then each time after twice as long
            until_s = min(2.0 * self._step_s * 2.0 ** min(self.tries, 30), until_s)
            self.tries += 1
        self.outage = Outage(trouble, reason, until_s, cap_kw)
        self.off_target = 0
        return self.outage.finding()


def _off(asked_kw: float, power_kw: float) -> str:
    asked, power = rounded(asked_kw, 4), rounded(power_kw, 4)
    return f"it does not follow its set-point: {asked} kW set, {power} kW measured"
