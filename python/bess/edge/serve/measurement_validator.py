"""What measurements may be trusted: every string is watched by itself, and every doubt has a sentence."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Final

import numpy as np

from bess.arrays import Array, Flags
from bess.edge.plant_io import Measurements
from bess.edge.serve.ageing import Ageing
from bess.edge.serve.persistent import Persistent
from bess.edge.serve.valid_state import ValidState
from bess.study.sections import ServiceSection
from bess.system import State, System

HOTTEST_C: Final = 90.0
COLDEST_C: Final = -40.0
"""No battery in service has another temperature; a sensor has."""
SOC_SLACK: Final = 0.03
"""What a reading may be off what was expected by other errors than that of a broken sensor."""
FASTEST_C_PER_S: Final = 0.2
TEMPERATURE_SLACK_K: Final = 5.0
AGREEING: Final = 3
"""Number of consistent readings after a jump until they are accepted."""
COARSEST_SOC: Final = 0.01
FINEST_SOC: Final = 0.001
"""Resolution of states of charge: whole per cent until a smaller change is seen."""
FOLLOWS_WITHIN: Final = 0.1
"""Share of nominal power by which a string may be off its set-point."""
NOT_FOLLOWING: Final = 2
"""Readings off the set-point in a row."""
READ_BACK_WITHIN: Final = 0.02
"""Share of nominal power by which a device may round a set-point."""
REMEMBERED: Final = 6
"""Set-points between which a string may still be that is on its way."""


@dataclass
class _StringMonitor(Persistent):
    """Memory of one string."""

    soc: float | None = None
    temperature_c: float | None = None
    other_soc: float | None = None
    agreeing: int = 0
    unchanged: int = 0
    moved: float = 0.0
    resolution: float = COARSEST_SOC
    last_reading: float | None = None
    last_power_kw: float | None = None
    flow_kw: float = 0.0
    flow_s: float = 0.0
    was_out: bool = False
    stands: str = ""
    missing_s: float = 0.0
    off_target: int = 0
    on_target: int = 0
    tries: int = 0
    cap_kw: float | None = None
    out_reason: str = ""
    out_s: float = 0.0
    out_until_s: float = 0.0
    asked_kw: list[float] = field(default_factory=list)
    other: bool = False
    rest_s: float = 0.0


_StringMonitor.kept = tuple(entry.name for entry in fields(_StringMonitor))


class MeasurementValidator(Persistent):
    """Watches the measurements of all strings.

    Parameters
    ----------
    system
        The plant's parameters.
    service
        Settings of the live controller.
    step_s
        Its control step.
    ageing
        Says what capacity is left.
    """

    kept = ("_watch",)

    def __init__(self, system: System, service: ServiceSection, step_s: float, ageing: Ageing) -> None:
        self._system, self._service, self._step_s = system, service, step_s
        self._ageing = ageing
        self._watch = [_StringMonitor() for _ in range(system.n_strings)]
        self._window = [(s.battery.soc_min, s.battery.soc_max) for s in system.strings]
        self._energy_kwh = system.nominal_energy_kwh * ageing.soh_capacity
        self._late_s = 0.0
        self._last_time: str | None = None

    def __call__(
        self, measured: Measurements, asked_kw: Array, elapsed_s: float, *, drives: bool = True
    ) -> ValidState:
        """Judge new measurements.

        Parameters
        ----------
        measured
            What the plant says now.
        asked_kw
            Set-points that were in force since the last call.
        elapsed_s
            Time since then.
        drives
            Whether those set-points reached the plant; else ``asked_kw`` is what it did by itself.
        """
        n = self._system.n_strings
        self._energy_kwh = self._system.nominal_energy_kwh * self._ageing.soh_capacity
        charge, discharge = self._limit(measured.charge_limit_kw), self._limit(measured.discharge_limit_kw)
        late = self._is_late(measured, elapsed_s)
        in_service = np.zeros(n, dtype=bool)
        soc, temperature = np.empty(n), np.empty(n)
        low, high, flow = np.empty(n), np.empty(n), np.empty(n)
        reasons = []
        for i, watch in enumerate(self._watch):
            reason, out = self._judge(i, watch, measured, float(asked_kw[i]), elapsed_s, drives)
            if late and not out:
                reason, out = late, True
            low_i, high_i = self._range(i, watch)
            low[i], high[i] = low_i, high_i
            soc[i] = min(max(watch.soc if watch.soc is not None else 0.5, low_i), high_i)
            temperature[i] = self._system.ambient_c if watch.temperature_c is None else watch.temperature_c
            in_service[i] = not out
            flow[i] = self._flow_kw(watch, measured, i, elapsed_s, out=out)
            watch.was_out = out
            if out:
                charge[i] = discharge[i] = 0.0
            elif watch.cap_kw is not None:
                charge[i], discharge[i] = min(charge[i], watch.cap_kw), min(discharge[i], watch.cap_kw)
            reasons.append(reason)
        state = State(soc, temperature, self._ageing.soh_capacity, self._ageing.soh_resistance)
        others = np.array([watch.other for watch in self._watch])
        flowing = self._at_meter(measured, in_service, flow)
        return ValidState(state, low, high, charge, discharge, in_service, tuple(reasons), others, flowing)

    def _flow_kw(
        self, watch: _StringMonitor, measured: Measurements, i: int, elapsed_s: float, *, out: bool
    ) -> float:
        """Last known power of a string out of service, until its watchdog must have acted.

        A value that stands still from then on may be that of a lost device. A string that is only now taken
        out rests as soon as its set-point is taken back, unless it is out of reach.
        """
        power_kw = float(measured.power_kw[i])
        is_plausible = abs(power_kw) <= (1.0 + FOLLOWS_WITHIN) * self._system.nominal_kw[i]
        is_new = is_plausible and (power_kw != watch.flow_kw or not out)
        watch.flow_s = 0.0 if is_new else watch.flow_s + elapsed_s
        watch.flow_kw = power_kw if is_new else watch.flow_kw
        is_lost = watch.stands == "all" or (measured.available[i] and not watch.was_out)
        return 0.0 if not out or is_lost or watch.flow_s > self._service.watchdog_s else watch.flow_kw

    def _at_meter(self, measured: Measurements, in_service: Flags, flow_kw: Array) -> Array:
        """Correct the power of strings out of service to what the plant's meter shows less the others."""
        nominal_kw = np.where(in_service, 0.0, self._system.nominal_kw)
        readings = np.append(measured.power_kw[in_service], measured.plant_kw)  # NaN without a meter
        if np.isfinite(readings).all():
            missing_kw = measured.plant_kw - measured.power_kw[in_service].sum() - flow_kw.sum()
            most_kw = 2.0 * (1.0 + FOLLOWS_WITHIN) * nominal_kw.sum()  # full power one way, to the other
            if READ_BACK_WITHIN * nominal_kw.sum() < abs(missing_kw) <= most_kw:
                flow_kw = flow_kw + missing_kw * nominal_kw / nominal_kw.sum()
        return np.where(np.abs(flow_kw) > READ_BACK_WITHIN * self._system.nominal_kw, flow_kw, 0.0)

    def _limit(self, said_kw: Array) -> Array:
        """What plant and inverters allow in one direction; nothing where the plant says no number."""
        return np.clip(np.nan_to_num(said_kw, nan=0.0, posinf=np.inf), 0.0, self._system.nominal_kw)

    def _is_late(self, measured: Measurements, elapsed_s: float) -> str:
        """A sentence if the plant has repeated the same old measurements for too long."""
        stamp = measured.time.isoformat()
        self._late_s = self._late_s + elapsed_s if stamp == self._last_time else 0.0
        self._last_time = stamp
        if self._late_s <= self._service.late_after_s:
            return ""
        return f"measurements are {self._late_s:.0f} s old, {self._service.late_after_s:g} s are allowed"

    def _range(self, i: int, watch: _StringMonitor) -> tuple[float, float]:
        """Both values a state of charge may have, within its window."""
        values = [v for v in (watch.soc, watch.other_soc) if v is not None] or [0.5]
        low, high = self._window[i]
        return min(max(min(values), low), high), min(max(max(values), low), high)

    def _judge(
        self,
        i: int,
        watch: _StringMonitor,
        measured: Measurements,
        asked_kw: float,
        elapsed_s: float,
        drives: bool,
    ) -> tuple[str, bool]:
        """Reason, and whether the string is out."""
        power = float(measured.power_kw[i])
        carried = power if np.isfinite(power) else asked_kw
        soc, temperature = float(measured.soc[i]), float(measured.temperature_c[i])
        expected = -carried * elapsed_s / 3600.0 / self._energy_kwh[i]
        if not measured.available[i]:
            self._forgive(watch)
            watch.unchanged, watch.moved = 0, 0.0
            if np.isfinite(soc) and 0.0 <= soc <= 1.0:
                watch.soc, watch.other_soc, watch.agreeing = soc, None, 0
            remark = measured.remarks[i] if measured.remarks else ""
            return remark or "out of service, says the plant", True
        if not np.isfinite(soc):
            watch.missing_s += elapsed_s
            if watch.soc is None or watch.missing_s > self._service.late_after_s:
                return "its state of charge is missing", True
            watch.soc = min(max(watch.soc + expected, 0.0), 1.0)
            return f"its state of charge is missing for {watch.missing_s:.0f} s and estimated", False
        watch.missing_s = 0.0
        if not -0.005 <= soc <= 1.005:
            return f"its state of charge of {100.0 * soc:.4g} % is implausible", True
        if np.isfinite(temperature) and not COLDEST_C <= temperature <= HOTTEST_C:
            return f"its temperature of {temperature:.4g} °C is implausible", True
        soc = min(max(soc, 0.0), 1.0)
        doubt = self._take_soc(i, watch, soc, expected, elapsed_s)
        doubt = self._take_temperature(watch, temperature, elapsed_s) or doubt
        same_power = watch.last_power_kw is not None and power == watch.last_power_kw
        watch.last_power_kw = power if np.isfinite(power) else None
        held_kw = np.nan if measured.setpoint_kw is None else float(measured.setpoint_kw[i])
        if watch.other:
            return self._left_alone(i, watch, power, held_kw, elapsed_s)
        if watch.out_reason:
            moves = soc != watch.last_reading or (watch.stands == "all" and not same_power)
            return self._still_out(watch, moves, soc, elapsed_s)
        if self._is_frozen(watch, soc, abs(expected)):
            watch.out_until_s, watch.stands = self._service.retry_after_s, "soc"
            return self._take_out(
                watch,
                f"its state of charge has stood at {100.0 * soc:.4g} % for {watch.unchanged} readings "
                "while it carried power",
                0.0,
            )
        watch.last_reading = soc
        if drives and (sentence := self._other_writer(i, watch, power, held_kw, asked_kw)):
            watch.other, watch.out_until_s = True, self._next_try_s(watch)
            self._take_out(watch, sentence, 0.0)
            return sentence, True
        if np.isfinite(power) and (sentence := self._does_not_follow(i, watch, power, asked_kw)):
            if same_power and power != 0.0 and watch.unchanged >= NOT_FOLLOWING:
                # It may follow; its reported values are frozen.
                watch.out_until_s, watch.stands = self._service.retry_after_s, "all"
                stood = (
                    f"its state of charge has stood at {100.0 * soc:.4g} % and its power at {power:.4g} kW"
                )
                return self._take_out(watch, f"{stood}, for any set-point", 0.0)
            watch.out_until_s = self._next_try_s(watch)
            same_way = power * asked_kw > 0.0 and abs(power) < abs(asked_kw)
            return self._take_out(watch, sentence, abs(power) if same_way else 0.0)
        return doubt, False

    def _take_soc(self, i: int, watch: _StringMonitor, soc: float, expected: float, elapsed_s: float) -> str:
        """Accept a plausible reading; after a jump, keep both values until readings agree."""
        span_s = max(elapsed_s, self._step_s)
        reach = SOC_SLACK + 1.2 * self._system.nominal_kw[i] * span_s / 3600.0 / self._energy_kwh[i]
        if watch.soc is None or abs(soc - watch.soc - expected) <= reach:
            if watch.soc is not None and 0.0 < abs(soc - watch.soc) < watch.resolution:
                watch.resolution = max(abs(soc - watch.soc), FINEST_SOC)
            watch.soc, watch.other_soc, watch.agreeing = soc, None, 0
            return ""
        agrees = watch.other_soc is not None and abs(soc - watch.other_soc - expected) <= reach
        watch.agreeing = watch.agreeing + 1 if agrees else 1
        before = watch.soc
        if watch.agreeing >= AGREEING:
            watch.soc, watch.other_soc, watch.agreeing = soc, None, 0
            return f"its state of charge jumped from {100.0 * before:.4g} % to {100.0 * soc:.4g} % and stays"
        watch.soc = min(max(before + expected, 0.0), 1.0)
        watch.other_soc = soc
        return (
            f"its state of charge jumped from {100.0 * before:.4g} % to {100.0 * soc:.4g} %; "
            "the more conservative of both values applies"
        )

    def _take_temperature(self, watch: _StringMonitor, temperature_c: float, elapsed_s: float) -> str:
        if not np.isfinite(temperature_c):
            return "its temperature is unknown" if watch.temperature_c is None else ""
        before = watch.temperature_c
        reach = TEMPERATURE_SLACK_K + FASTEST_C_PER_S * max(elapsed_s, self._step_s)
        if before is None or abs(temperature_c - before) <= reach or temperature_c > before:
            # A sudden rise is accepted at once, which is safe.
            watch.temperature_c = temperature_c
            return ""
        watch.temperature_c = before - reach
        return (
            f"its temperature fell from {before:.4g} °C to {temperature_c:.4g} °C at once, implausibly fast"
        )

    def _is_frozen(self, watch: _StringMonitor, soc: float, moved: float) -> bool:
        if watch.last_reading is None or soc != watch.last_reading:
            watch.unchanged, watch.moved = 0, 0.0
            return False
        watch.unchanged += 1
        watch.moved += moved
        enough = watch.moved >= 2.0 * watch.resolution
        return watch.unchanged >= self._service.frozen_readings and enough

    def _does_not_follow(self, i: int, watch: _StringMonitor, power_kw: float, asked_kw: float) -> str:
        off = abs(power_kw - asked_kw) > FOLLOWS_WITHIN * self._system.nominal_kw[i]
        watch.off_target = watch.off_target + 1 if off else 0
        watch.on_target = 0 if off or not asked_kw else watch.on_target + 1
        if watch.on_target >= self._service.frozen_readings:
            watch.tries = 0
        if watch.off_target < NOT_FOLLOWING:
            return ""
        return _off(asked_kw, power_kw)

    def _other_writer(
        self, i: int, watch: _StringMonitor, power_kw: float, held_kw: float, asked_kw: float
    ) -> str:
        """Return a sentence if set-point or power of the string differ from all recent set-points.

        A string that is on its way, or limits itself, gives what lies between its last set-points and zero.
        """
        nominal_kw = self._system.nominal_kw[i]
        watch.asked_kw = [*watch.asked_kw, asked_kw][-REMEMBERED:]
        who = f"another controller writes to string {i}"
        # A device that has started anew holds zero.
        if min(abs(held_kw), abs(held_kw - asked_kw)) > READ_BACK_WITHIN * nominal_kw:
            return f"{who}: set-point read back {held_kw:.4g} kW, commanded {asked_kw:.4g} kW"
        slack_kw = FOLLOWS_WITHIN * nominal_kw
        low_kw, high_kw = min(0.0, *watch.asked_kw) - slack_kw, max(0.0, *watch.asked_kw) + slack_kw
        if low_kw <= power_kw <= high_kw or not np.isfinite(power_kw) or watch.off_target + 1 < NOT_FOLLOWING:
            return ""
        return f"{who}, or it hangs; {_off(asked_kw, power_kw)}"

    def _left_alone(
        self, i: int, watch: _StringMonitor, power_kw: float, held_kw: float, elapsed_s: float
    ) -> tuple[str, bool]:
        """Until the string has rested for a while: of two controllers one gives way.

        A plant that names no set-points may go on with one whose controller has gone, so it is tried, ever
        later.
        """
        nominal_kw = self._system.nominal_kw[i]
        rests = abs(np.nan_to_num(power_kw)) <= FOLLOWS_WITHIN * nominal_kw
        rests &= not abs(held_kw) > READ_BACK_WITHIN * nominal_kw
        watch.rest_s = watch.rest_s + elapsed_s if rests else 0.0
        watch.out_s += elapsed_s
        patience_s = self._service.retry_after_s * 2.0 ** min(watch.tries, 30)
        may_be_left = not np.isfinite(held_kw) and watch.out_s >= patience_s
        if watch.rest_s < watch.out_until_s and not may_be_left:
            return watch.out_reason, True
        self._forgive(watch)
        return "", False

    def _next_try_s(self, watch: _StringMonitor) -> float:
        """Return the delay until the next try, which doubles with each try."""
        soon_s = 2.0 * self._step_s * 2.0 ** min(watch.tries, 30)
        watch.tries += 1
        return min(soon_s, self._service.retry_after_s)

    def _take_out(self, watch: _StringMonitor, sentence: str, cap_kw: float) -> tuple[str, bool]:
        watch.out_reason, watch.out_s, watch.cap_kw = sentence, 0.0, cap_kw
        watch.off_target = 0
        return self._out_sentence(watch), cap_kw == 0.0

    def _still_out(
        self, watch: _StringMonitor, moves: bool, soc: float, elapsed_s: float
    ) -> tuple[str, bool]:
        """Exclude the string until the next try; a frozen value that changes again is accepted at once."""
        watch.out_s += elapsed_s
        if (watch.stands and moves) or watch.out_s >= watch.out_until_s:
            self._forgive(watch)
            watch.unchanged, watch.moved, watch.last_reading = 0, 0.0, soc
            return "", False
        return self._out_sentence(watch), watch.cap_kw == 0.0

    def _out_sentence(self, watch: _StringMonitor) -> str:
        left_s = max(0.0, watch.out_until_s - watch.out_s)
        return f"{watch.out_reason}; tried again in {left_s:.0f} s"

    def _forgive(self, watch: _StringMonitor) -> None:
        watch.out_reason, watch.out_s, watch.cap_kw, watch.off_target = "", 0.0, None, 0
        watch.stands, watch.other, watch.rest_s = "", False, 0.0


def _off(asked_kw: float, power_kw: float) -> str:
    return f"it does not follow its set-point: {asked_kw:.4g} kW set, {power_kw:.4g} kW measured"
