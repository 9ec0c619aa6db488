"""The control law of an explicit controller: which strings are on, and at what power.

Written in the part of Python that :mod:`bess.edge.distil.translate` turns into C, structured text and Rust:
numbers, arrays of fixed size, tables, loops, ``+ - * /``, ``abs``, ``max``, ``min`` and ``sqrt``. All
translations perform the same operations in the same order, so their results agree to the last bit. Names in
capitals are tables and constants of :class:`bess.control.explicit.tables.Tables`. Structured text has no
short-circuit evaluation and ignores case, so conditions do not rely on it and names differ in more than case.
"""

# ruff: noqa: F821
# mypy: ignore-errors

from math import sqrt

from bess.control.explicit.language import Flags, Floats, falses, zeros

# Indices of the demand features (outlook).
O_OUT_KWH = 0
O_IN_KWH = 1
O_PEAK_KW = 2
O_NEAR_KW = 3
O_FAR_KW = 4
N_OUTLOOK = 5

# Weights of one direction; the weights of charge precede those of discharge.
W_BALANCE = 0
W_BALANCE_OUT = 1
W_BALANCE_IN = 2
W_BALANCE_PEAK = 3
W_RESERVE = 4
W_RESERVE_LOWEST = 7
W_RESERVE_SCARCE = 10
W_FULL = 11
W_FULL_SCARCE = 12
W_WORTH = 13
W_WORTH_SCARCE = 14
PER_SIDE = 15
# Weights for both directions.
W_HEAT = 30
W_HEAT_FAR = 35
W_HEAT_NEAR = 36
W_KEEPS = 37
N_WEIGHTS = 38


def look(ahead_kw: Floats, outlook: Floats) -> None:
    """Compute the demand features of a forecast.

    ``outlook`` receives five numbers: the maximum cumulative net energy of discharge and of charge [kWh], the
    maximum power in the first hours [kW], and the mean power over these hours and over the forecast [kW].
    """
    level_kwh: float = 0.0
    out_kwh: float = 0.0
    in_kwh: float = 0.0
    peak_kw: float = 0.0
    near_kw: float = 0.0
    far_kw: float = 0.0
    for n in range(STEPS):
        level_kwh += ahead_kw[n] * STEP_H
        out_kwh = max(out_kwh, level_kwh)
        in_kwh = max(in_kwh, -level_kwh)
        far_kw += abs(ahead_kw[n])
        if n < NEAR_STEPS:
            near_kw += abs(ahead_kw[n])
            peak_kw = max(peak_kw, abs(ahead_kw[n]))
    outlook[O_OUT_KWH] = out_kwh
    outlook[O_IN_KWH] = in_kwh
    outlook[O_PEAK_KW] = peak_kw
    outlook[O_NEAR_KW] = near_kw * NEAR_SHARE
    outlook[O_FAR_KW] = far_kw * STEP_SHARE


def split(
    soc: Floats,
    temperature_c: Floats,
    soh_capacity: Floats,
    soh_resistance: Floats,
    limit_kw: Floats,
    demand_kw: float,
    outlook: Floats,
    request_kw: Floats,
) -> None:
    """Allocate ``demand_kw`` to the strings; ``request_kw`` sums to it up to the minimum power.

    The cost of a string is a parabola through its cost at three requests: zero (inverter on), half and full
    capability. Costs are losses, undelivered energy, and prices of the final state, which depend on the
    weights. Starting from all strings, the string with the smallest benefit is switched off repeatedly. The
    cheapest of these sets is selected, each with and without a request above the capability of one string.
    """
    top_kw: Floats = zeros(STRINGS + 1)
    c0: Floats = zeros(STRINGS + 1)
    c1: Floats = zeros(STRINGS + 1)
    c2: Floats = zeros(STRINGS + 1)
    u_kw: Floats = zeros(STRINGS + 1)
    filled: Floats = zeros(STRINGS)
    cost_kw: Floats = zeros(3)
    runs: Flags = falses(STRINGS)
    open_: Flags = falses(STRINGS + 1)
    need_kw: float = abs(demand_kw)
    side: int = 0
    sign: float = 1.0
    if demand_kw > 0.0:
        side = 1
        sign = -1.0

    # The plant as one storage, and the scarcity of its energy and headroom.
    held_kwh: float = 0.0
    store_kwh: float = 0.0
    plant_kw: float = 0.0
    lowest: int = 0
    for m in range(STRINGS):
        filled[m] = (soc[m] - SOC_MIN[m]) / (SOC_MAX[m] - SOC_MIN[m])
        if filled[m] < filled[lowest]:
            lowest = m
        held_kwh += filled[m] * ENERGY_KWH[m] * soh_capacity[m]
        store_kwh += ENERGY_KWH[m] * soh_capacity[m]
        plant_kw += limit_kw[m]
    level: float = max(0.0, min(store_kwh, held_kwh + sign * need_kw * STEP_H)) / store_kwh
    short_out: float = min(2.0, outlook[O_OUT_KWH] / (held_kwh + 0.05 * store_kwh))
    short_in: float = min(2.0, outlook[O_IN_KWH] / (store_kwh - held_kwh + 0.05 * store_kwh))
    peak: float = min(1.0, outlook[O_PEAK_KW] / (plant_kw + 1.0))
    near: float = outlook[O_NEAR_KW] / (plant_kw + 1.0)
    far: float = outlook[O_FAR_KW] / (plant_kw + 1.0)

    # Prices of the final state.
    first: int = side * PER_SIDE
    balance: float = WEIGHTS[first + W_BALANCE] + WEIGHTS[first + W_BALANCE_PEAK] * peak
    balance += WEIGHTS[first + W_BALANCE_OUT] * short_out + WEIGHTS[first + W_BALANCE_IN] * short_in
    balance = 0.02 * max(0.0, balance)
    scarce: float = max(0.0, 1.0 + WEIGHTS[first + W_RESERVE_SCARCE] * (short_out - 1.0))
    full: float = max(0.0, WEIGHTS[first + W_FULL] + WEIGHTS[first + W_FULL_SCARCE] * (short_in - 1.0))
    worth: float = WEIGHTS[first + W_WORTH] + WEIGHTS[first + W_WORTH_SCARCE] * (short_out - 1.0)
    worth = max(0.0, min(1.0, worth))
    lost: float = 1.0 + SHORTFALL * worth
    shed: float = SHORTFALL * (1.0 + worth)
    if side == 1:
        shed = SHORTFALL * (1.0 - worth * WEIGHTS[W_KEEPS])
    busy: float = 1.0 + WEIGHTS[W_HEAT_FAR] * (far - 0.3) + WEIGHTS[W_HEAT_NEAR] * (near - 0.3)
    busy = max(0.0, busy)

    shedder: int = 0
    spare_kw: float = 0.0
    for m in range(STRINGS):
        full_ah: float = CAPACITY_AH[m] * soh_capacity[m]
        power_at: int = m * POWER_KNOTS
        loss_at: int = (side * STRINGS + m) * POWER_KNOTS

        # Derating factor, and the price of heat.
        i: int = 0
        j: int = 0
        a: int = m * DERATING_KNOTS
        while j < DERATING_KNOTS - 2 and temperature_c[m] >= DERATING_C[a + j + 1]:
            j += 1
        a += j
        y: float = (temperature_c[m] - DERATING_C[a]) / (DERATING_C[a + 1] - DERATING_C[a])
        y = max(0.0, min(1.0, y))
        k: float = DERATING_FACTOR[a] + y * (DERATING_FACTOR[a + 1] - DERATING_FACTOR[a])
        over_k: float = temperature_c[m] - DERATING_START_C[m]
        j = 0
        while j < HEAT_KNOTS - 2 and over_k >= HEAT_K[j + 1]:
            j += 1
        y = max(0.0, min(1.0, (over_k - HEAT_K[j]) / (HEAT_K[j + 1] - HEAT_K[j])))
        heat: float = WEIGHTS[W_HEAT + j] + y * (WEIGHTS[W_HEAT + j + 1] - WEIGHTS[W_HEAT + j])
        heat = lost + busy * heat
        reserve: int = first + W_RESERVE
        if m == lowest:
            reserve = first + W_RESERVE_LOWEST

        j = 0
        while j < TEMPERATURE_KNOTS - 2 and temperature_c[m] >= TEMPERATURE_AXIS[j + 1]:
            j += 1
        y = TEMPERATURE_AXIS[j + 1] - TEMPERATURE_AXIS[j]
        y = max(0.0, min(1.0, (temperature_c[m] - TEMPERATURE_AXIS[j]) / y))
        table: int = (side * STRINGS + m) * SOC_KNOTS * TEMPERATURE_KNOTS + j
        voltage_v: float = 1.0
        for part in range(3):
            # Coefficients in the middle of the step; the first pass, which finds the limit, uses its start.
            middle: float = soc[m]
            if part > 0:
                middle += sign * 500.0 * k * SHARE[part] * top_kw[m] / voltage_v * STEP_H / full_ah
            i = 0
            while i < SOC_KNOTS - 2 and middle >= SOC_AXIS[i + 1]:
                i += 1
            x: float = max(0.0, min(1.0, (middle - SOC_AXIS[i]) / (SOC_AXIS[i + 1] - SOC_AXIS[i])))
            a = table + i * TEMPERATURE_KNOTS
            b: int = a + TEMPERATURE_KNOTS
            below: float = OCV_V[a] + y * (OCV_V[a + 1] - OCV_V[a])
            above: float = OCV_V[b] + y * (OCV_V[b + 1] - OCV_V[b])
            voltage_v = below + x * (above - below)
            below = RESISTANCE_OHM[a] + y * (RESISTANCE_OHM[a + 1] - RESISTANCE_OHM[a])
            above = RESISTANCE_OHM[b] + y * (RESISTANCE_OHM[b + 1] - RESISTANCE_OHM[b])
            ohm: float = (below + x * (above - below)) * soh_resistance[m]
            if part == 0:
                # Maximum power within the SOC window at the end of the step and within the voltage limits.
                room_a: float = (SOC_MAX[m] - soc[m]) * full_ah / STEP_H
                room_a = min(room_a, (VOLTAGE_MAX_V[m] - voltage_v) / ohm)
                if side == 1:
                    room_a = min((soc[m] - SOC_MIN[m]) * full_ah / STEP_H, 0.5 * voltage_v / ohm)
                    room_a = min(room_a, (voltage_v - VOLTAGE_MIN_V[m]) / ohm)
                room_a = max(0.0, room_a)
                inner_kw: float = room_a * (voltage_v + sign * ohm * room_a) / 1000.0
                j = 0
                while (
                    j < POWER_KNOTS - 2
                    and POWER_KW[power_at + j + 1] - sign * LOSS_KW[loss_at + j + 1] <= inner_kw
                ):
                    j += 1
                below = POWER_KW[power_at + j] - sign * LOSS_KW[loss_at + j]
                above = POWER_KW[power_at + j + 1] - sign * LOSS_KW[loss_at + j + 1]
                most_kw: float = 0.0
                if above <= inner_kw:
                    most_kw = POWER_KW[power_at + j + 1]
                elif below <= inner_kw:
                    most_kw = POWER_KW[power_at + j + 1] - POWER_KW[power_at + j]
                    most_kw = POWER_KW[power_at + j] + (inner_kw - below) / (above - below) * most_kw
                top_kw[m] = limit_kw[m]
                if k * limit_kw[m] > most_kw:
                    top_kw[m] = most_kw / k
                if limit_kw[m] - top_kw[m] > spare_kw:
                    spare_kw = limit_kw[m] - top_kw[m]
                    shedder = m
                top_kw[m] = min(top_kw[m], need_kw)
            u: float = SHARE[part] * top_kw[m]
            p: float = k * u
            j = 0
            while j < POWER_KNOTS - 2 and p >= POWER_KW[power_at + j + 1]:
                j += 1
            x = (p - POWER_KW[power_at + j]) / (POWER_KW[power_at + j + 1] - POWER_KW[power_at + j])
            loss: float = LOSS_KW[loss_at + j] + x * (LOSS_KW[loss_at + j + 1] - LOSS_KW[loss_at + j])
            inner_w: float = 1000.0 * (p - sign * loss)
            root: float = sqrt(max(0.0, voltage_v * voltage_v + sign * 4.0 * ohm * inner_w))
            current_a: float = 2.0 * inner_w / (voltage_v + root)
            after: float = sign * current_a * STEP_H / (full_ah * (SOC_MAX[m] - SOC_MIN[m])) + filled[m]
            value: float = (after - level) * (after - level) - (filled[m] - level) * (filled[m] - level)
            value = balance * value
            for h in range(LOW_KNOTS):
                above = max(0.0, LOW_FILL[h] - after)
                below = max(0.0, LOW_FILL[h] - filled[m])
                above = scarce * (above * above - below * below) / LOW_FILL[h]
                value += max(0.0, WEIGHTS[reserve + h]) * above
            above = max(0.0, after - HIGH_FILL)
            below = max(0.0, filled[m] - HIGH_FILL)
            value += full * (above * above - below * below)
            cost_kw[part] = lost * (loss - IDLE_LOSS_KW[m]) + heat * ohm * current_a * current_a / 1000.0
            cost_kw[part] += SHORTFALL * (1.0 - k) * u + value * ENERGY_KWH[m] / STEP_H
        if top_kw[m] > 0.0:
            runs[m] = True
            c0[m] = cost_kw[0]
            c2[m] = 2.0 * (cost_kw[2] - 2.0 * cost_kw[1] + cost_kw[0]) / (top_kw[m] * top_kw[m])
            c2[m] = max(c2[m], FLATTEST)
            c1[m] = (cost_kw[2] - cost_kw[0]) / top_kw[m] - c2[m] * top_kw[m]

    # The string with the lowest capability relative to its limit may get a request above its capability.
    base_kw: float = 0.0
    if spare_kw > 0.0:
        base_kw = top_kw[shedder]
        if base_kw > 0.0:
            c0[STRINGS] = c0[shedder] + base_kw * (c1[shedder] + c2[shedder] * base_kw)
        c1[STRINGS] = shed
        c2[STRINGS] = SHED_SLOPE
        top_kw[STRINGS] = min(spare_kw, need_kw - base_kw)

    least: float = UNBOUNDED
    room_kw: float = 0.0
    for m in range(STRINGS):
        room_kw += top_kw[m]
        request_kw[m] = top_kw[m]
    more: bool = need_kw > 0.0
    leaver: int = STRINGS
    everybody: bool = True
    while more:
        more = False
        cheapest: float = UNBOUNDED
        for away in range(STRINGS + 1):
            tried: bool = False
            if away == STRINGS:
                tried = everybody
            elif not everybody:
                tried = runs[away]
            for sheds in range(2):
                room_now_kw: float = room_kw - top_kw[away]
                if away == STRINGS:
                    room_now_kw = room_kw
                rest_kw: float = need_kw
                possible: bool = tried
                if sheds == 1:
                    possible = tried and spare_kw > 0.0
                    rest_kw = need_kw - base_kw
                    room_now_kw += top_kw[STRINGS]
                    if runs[shedder] and shedder != away:
                        room_now_kw = room_now_kw - top_kw[shedder]
                if possible and room_now_kw + CRUMBS * plant_kw >= rest_kw:
                    cost: float = 0.0
                    for m in range(STRINGS + 1):
                        u_kw[m] = 0.0
                        if m == STRINGS:
                            open_[m] = sheds == 1
                        else:
                            open_[m] = runs[m] and m != away and not (sheds == 1 and m == shedder)
                        if open_[m]:
                            cost += c0[m]
                    # Equal marginal cost; strings at an end of their range are fixed (Bitran and Hax).
                    unsettled: bool = True
                    while unsettled:
                        unsettled = False
                        ease: float = 0.0
                        offset: float = rest_kw
                        for m in range(STRINGS + 1):
                            if open_[m]:
                                ease += 0.5 / c2[m]
                                offset += 0.5 * c1[m] / c2[m]
                        if ease > 0.0:
                            over: float = 0.0
                            under: float = 0.0
                            for m in range(STRINGS + 1):
                                if open_[m]:
                                    u_kw[m] = 0.5 * (offset / ease - c1[m]) / c2[m]
                                    over += max(0.0, u_kw[m] - top_kw[m])
                                    under += max(0.0, -u_kw[m])
                            for m in range(STRINGS + 1):
                                if open_[m] and over > 0.0 and over >= under and u_kw[m] >= top_kw[m]:
                                    u_kw[m] = top_kw[m]
                                    rest_kw = rest_kw - top_kw[m]
                                    open_[m] = False
                                    unsettled = True
                                elif open_[m] and over < under and u_kw[m] <= 0.0:
                                    u_kw[m] = 0.0
                                    open_[m] = False
                                    unsettled = True
                    for m in range(STRINGS + 1):
                        cost += u_kw[m] * (c1[m] + c2[m] * u_kw[m])
                    if sheds == 1:
                        u_kw[shedder] = base_kw + u_kw[STRINGS]
                    if cost < least:
                        least = cost
                        for m in range(STRINGS):
                            request_kw[m] = u_kw[m]
                    if cost < cheapest:
                        cheapest = cost
                        leaver = away
                        more = True
        if more and not everybody:
            runs[leaver] = False
            room_kw = room_kw - top_kw[leaver]
        everybody = False

    # Demand above the total capability is requested within the free inverter power. The rounding remainder
    # goes to a string that is on, so it switches no inverter on.
    missing_kw: float = need_kw
    free_kw: float = 0.0
    largest: int = 0
    for m in range(STRINGS):
        missing_kw = missing_kw - request_kw[m]
        free_kw += limit_kw[m] - request_kw[m]
        if request_kw[m] > request_kw[largest]:
            largest = m
    if missing_kw > CRUMBS * plant_kw and free_kw > 0.0:
        for m in range(STRINGS):
            request_kw[m] += missing_kw / free_kw * (limit_kw[m] - request_kw[m])
    else:
        request_kw[largest] += missing_kw
    # A remainder below the minimum inverter power goes to the string that is on with the most headroom.
    room_kw = 0.0
    for m in range(STRINGS):
        request_kw[m] = max(0.0, min(limit_kw[m], request_kw[m]))
        if request_kw[m] >= MIN_POWER_KW and limit_kw[m] - request_kw[m] > room_kw:
            room_kw = limit_kw[m] - request_kw[m]
            largest = m
    for m in range(STRINGS):
        if m != largest and request_kw[m] < MIN_POWER_KW:
            request_kw[largest] += request_kw[m]
            request_kw[m] = 0.0
    request_kw[largest] = min(limit_kw[largest], request_kw[largest])
    if request_kw[largest] < MIN_POWER_KW:
        request_kw[largest] = 0.0
    for m in range(STRINGS):
        request_kw[m] = -sign * request_kw[m]
