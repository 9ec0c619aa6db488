//! The control law of an explicit controller: which strings are on, and at what power.
//!
//! `bess.edge.distil.translate` reads this file and translates it into C and structured text; all perform the same
//! operations in the same order, so their results agree to the last bit. It therefore uses numbers, arrays of fixed
//! size, tables (`t`), loops from 0, `+ - * /`, `f64::abs`, `f64::sqrt`, `larger` and `smaller` only, and every
//! variable states its type. Structured text has no short-circuit evaluation and ignores case, so conditions do not
//! rely on it and names differ in more than case.

use super::{Tables, MAX_STRINGS};
use crate::extremes::{larger, smaller};

// Indices of the demand features.
pub(crate) const FEATURE_DISCHARGE_KWH: usize = 0;
pub(crate) const FEATURE_CHARGE_KWH: usize = 1;
pub(crate) const FEATURE_PEAK_KW: usize = 2;
pub(crate) const FEATURE_NEAR_KW: usize = 3;
pub(crate) const FEATURE_MEAN_KW: usize = 4;
pub(crate) const N_FEATURES: usize = 5;

// Weights of one direction; the weights of charge precede those of discharge.
pub(crate) const W_BALANCE: usize = 0;
pub(crate) const W_BALANCE_OUT: usize = 1;
pub(crate) const W_BALANCE_IN: usize = 2;
pub(crate) const W_BALANCE_PEAK: usize = 3;
pub(crate) const W_RESERVE: usize = 4;
pub(crate) const W_RESERVE_LOWEST: usize = 7;
pub(crate) const W_RESERVE_SCARCE: usize = 10;
pub(crate) const W_FULL: usize = 11;
pub(crate) const W_FULL_SCARCE: usize = 12;
pub(crate) const W_WORTH: usize = 13;
pub(crate) const W_WORTH_SCARCE: usize = 14;
pub(crate) const PER_SIDE: usize = 15;
// Weights for both directions.
pub(crate) const W_HEAT: usize = 30;
pub(crate) const W_HEAT_FAR: usize = 35;
pub(crate) const W_HEAT_NEAR: usize = 36;
pub(crate) const W_KEEPS: usize = 37;
pub(crate) const N_WEIGHTS: usize = 38;

/// Compute the demand features of a forecast.
///
/// `features` receives five numbers: the maximum cumulative net energy of discharge and of charge [kWh], the maximum
/// power in the first hours [kW], and the mean power over these hours and over the forecast [kW].
pub(crate) fn demand_features(t: &Tables, ahead_kw: &[f64], features: &mut [f64]) {
    let mut level_kwh: f64 = 0.0;
    let mut out_kwh: f64 = 0.0;
    let mut in_kwh: f64 = 0.0;
    let mut peak_kw: f64 = 0.0;
    let mut near_kw: f64 = 0.0;
    let mut far_kw: f64 = 0.0;
    for n in 0..t.steps {
        level_kwh += ahead_kw[n] * t.step_h;
        out_kwh = larger(out_kwh, level_kwh);
        in_kwh = larger(in_kwh, -level_kwh);
        far_kw += f64::abs(ahead_kw[n]);
        if n < t.near_steps {
            near_kw += f64::abs(ahead_kw[n]);
            peak_kw = larger(peak_kw, f64::abs(ahead_kw[n]));
        }
    }
    features[FEATURE_DISCHARGE_KWH] = out_kwh;
    features[FEATURE_CHARGE_KWH] = in_kwh;
    features[FEATURE_PEAK_KW] = peak_kw;
    features[FEATURE_NEAR_KW] = near_kw * t.near_share;
    features[FEATURE_MEAN_KW] = far_kw * t.step_share;
}

/// Allocate `demand_kw` to the strings; `request_kw` sums to it up to the minimum power.
///
/// The cost of a string is a parabola through its cost at three requests: zero (inverter on), half and full
/// capability. Costs are losses, undelivered energy, and prices of the final state, which depend on the weights.
/// Starting from all strings, the string with the smallest benefit is switched off repeatedly. The cheapest of these
/// sets is selected, each with and without a request above the capability of one string.
pub(crate) fn split(
    t: &Tables,
    weights: &[f64],
    soc: &[f64],
    temperature_c: &[f64],
    soh_capacity: &[f64],
    soh_resistance: &[f64],
    limit_kw: &[f64],
    demand_kw: f64,
    features: &[f64],
    request_kw: &mut [f64],
) {
    let mut top_kw = [0.0; MAX_STRINGS + 1];
    let mut c0 = [0.0; MAX_STRINGS + 1];
    let mut c1 = [0.0; MAX_STRINGS + 1];
    let mut c2 = [0.0; MAX_STRINGS + 1];
    let mut u_kw = [0.0; MAX_STRINGS + 1];
    let mut filled = [0.0; MAX_STRINGS];
    let mut cost_kw = [0.0; 3];
    let mut runs = [false; MAX_STRINGS];
    let mut open_ = [false; MAX_STRINGS + 1];
    let need_kw: f64 = f64::abs(demand_kw);
    let mut side: usize = 0;
    let mut sign: f64 = 1.0;
    if demand_kw > 0.0 {
        side = 1;
        sign = -1.0;
    }

    // The plant as one storage, and the scarcity of its energy and headroom.
    let mut held_kwh: f64 = 0.0;
    let mut store_kwh: f64 = 0.0;
    let mut plant_kw: f64 = 0.0;
    let mut lowest: usize = 0;
    for m in 0..t.strings {
        filled[m] = (soc[m] - t.soc_min[m]) / (t.soc_max[m] - t.soc_min[m]);
        if filled[m] < filled[lowest] {
            lowest = m;
        }
        held_kwh += filled[m] * t.energy_kwh[m] * soh_capacity[m];
        store_kwh += t.energy_kwh[m] * soh_capacity[m];
        plant_kw += limit_kw[m];
    }
    let level: f64 = larger(0.0, smaller(store_kwh, held_kwh + sign * need_kw * t.step_h)) / store_kwh;
    let short_out: f64 = smaller(2.0, features[FEATURE_DISCHARGE_KWH] / (held_kwh + 0.05 * store_kwh));
    let short_in: f64 =
        smaller(2.0, features[FEATURE_CHARGE_KWH] / (store_kwh - held_kwh + 0.05 * store_kwh));
    let peak: f64 = smaller(1.0, features[FEATURE_PEAK_KW] / (plant_kw + 1.0));
    let near: f64 = features[FEATURE_NEAR_KW] / (plant_kw + 1.0);
    let far: f64 = features[FEATURE_MEAN_KW] / (plant_kw + 1.0);

    // Prices of the final state.
    let first: usize = side * PER_SIDE;
    let mut balance: f64 = weights[first + W_BALANCE] + weights[first + W_BALANCE_PEAK] * peak;
    balance += weights[first + W_BALANCE_OUT] * short_out + weights[first + W_BALANCE_IN] * short_in;
    balance = 0.02 * larger(0.0, balance);
    let scarce: f64 = larger(0.0, 1.0 + weights[first + W_RESERVE_SCARCE] * (short_out - 1.0));
    let full: f64 = larger(0.0, weights[first + W_FULL] + weights[first + W_FULL_SCARCE] * (short_in - 1.0));
    let mut worth: f64 = weights[first + W_WORTH] + weights[first + W_WORTH_SCARCE] * (short_out - 1.0);
    worth = larger(0.0, smaller(1.0, worth));
    let lost: f64 = 1.0 + t.shortfall * worth;
    let mut shed: f64 = t.shortfall * (1.0 + worth);
    if side == 1 {
        shed = t.shortfall * (1.0 - worth * weights[W_KEEPS]);
    }
    let mut busy: f64 = 1.0 + weights[W_HEAT_FAR] * (far - 0.3) + weights[W_HEAT_NEAR] * (near - 0.3);
    busy = larger(0.0, busy);

    let mut shedder: usize = 0;
    let mut spare_kw: f64 = 0.0;
    for m in 0..t.strings {
        let full_ah: f64 = t.capacity_ah[m] * soh_capacity[m];
        let power_at: usize = m * t.power_knots;
        let loss_at: usize = (side * t.strings + m) * t.power_knots;

        // Derating factor, and the price of heat.
        let mut i: usize = 0;
        let mut j: usize = 0;
        let mut a: usize = m * t.derating_knots;
        while j < t.derating_knots - 2 && temperature_c[m] >= t.derating_c[a + j + 1] {
            j += 1;
        }
        a += j;
        let mut y: f64 = (temperature_c[m] - t.derating_c[a]) / (t.derating_c[a + 1] - t.derating_c[a]);
        y = larger(0.0, smaller(1.0, y));
        let k: f64 = t.derating_factor[a] + y * (t.derating_factor[a + 1] - t.derating_factor[a]);
        let over_k: f64 = temperature_c[m] - t.derating_start_c[m];
        j = 0;
        while j < t.heat_knots - 2 && over_k >= t.heat_k[j + 1] {
            j += 1;
        }
        y = larger(0.0, smaller(1.0, (over_k - t.heat_k[j]) / (t.heat_k[j + 1] - t.heat_k[j])));
        let mut heat: f64 = weights[W_HEAT + j] + y * (weights[W_HEAT + j + 1] - weights[W_HEAT + j]);
        heat = lost + busy * heat;
        let mut reserve: usize = first + W_RESERVE;
        if m == lowest {
            reserve = first + W_RESERVE_LOWEST;
        }

        j = 0;
        while j < t.temperature_knots - 2 && temperature_c[m] >= t.temperature_axis[j + 1] {
            j += 1;
        }
        y = t.temperature_axis[j + 1] - t.temperature_axis[j];
        y = larger(0.0, smaller(1.0, (temperature_c[m] - t.temperature_axis[j]) / y));
        let table: usize = (side * t.strings + m) * t.soc_knots * t.temperature_knots + j;
        let mut voltage_v: f64 = 1.0;
        for part in 0..3 {
            // Coefficients in the middle of the step; the first pass, which finds the limit, uses its start.
            let mut middle: f64 = soc[m];
            if part > 0 {
                middle += sign * 500.0 * k * t.share[part] * top_kw[m] / voltage_v * t.step_h / full_ah;
            }
            i = 0;
            while i < t.soc_knots - 2 && middle >= t.soc_axis[i + 1] {
                i += 1;
            }
            let mut x: f64 =
                larger(0.0, smaller(1.0, (middle - t.soc_axis[i]) / (t.soc_axis[i + 1] - t.soc_axis[i])));
            a = table + i * t.temperature_knots;
            let b: usize = a + t.temperature_knots;
            let mut below: f64 = t.ocv_v[a] + y * (t.ocv_v[a + 1] - t.ocv_v[a]);
            let mut above: f64 = t.ocv_v[b] + y * (t.ocv_v[b + 1] - t.ocv_v[b]);
            voltage_v = below + x * (above - below);
            below = t.resistance_ohm[a] + y * (t.resistance_ohm[a + 1] - t.resistance_ohm[a]);
            above = t.resistance_ohm[b] + y * (t.resistance_ohm[b + 1] - t.resistance_ohm[b]);
            let ohm: f64 = (below + x * (above - below)) * soh_resistance[m];
            if part == 0 {
                // Maximum power within the SOC window at the end of the step and within the voltage limits.
                let mut room_a: f64 = (t.soc_max[m] - soc[m]) * full_ah / t.step_h;
                room_a = smaller(room_a, (t.voltage_max_v[m] - voltage_v) / ohm);
                if side == 1 {
                    room_a = smaller((soc[m] - t.soc_min[m]) * full_ah / t.step_h, 0.5 * voltage_v / ohm);
                    room_a = smaller(room_a, (voltage_v - t.voltage_min_v[m]) / ohm);
                }
                room_a = larger(0.0, room_a);
                let inner_kw: f64 = room_a * (voltage_v + sign * ohm * room_a) / 1000.0;
                j = 0;
                while j < t.power_knots - 2
                    && t.power_kw[power_at + j + 1] - sign * t.loss_kw[loss_at + j + 1] <= inner_kw
                {
                    j += 1;
                }
                below = t.power_kw[power_at + j] - sign * t.loss_kw[loss_at + j];
                above = t.power_kw[power_at + j + 1] - sign * t.loss_kw[loss_at + j + 1];
                let mut max_kw: f64 = 0.0;
                if above <= inner_kw {
                    max_kw = t.power_kw[power_at + j + 1];
                } else if below <= inner_kw {
                    max_kw = t.power_kw[power_at + j + 1] - t.power_kw[power_at + j];
                    max_kw = t.power_kw[power_at + j] + (inner_kw - below) / (above - below) * max_kw;
                }
                top_kw[m] = limit_kw[m];
                if k * limit_kw[m] > max_kw {
                    top_kw[m] = max_kw / k;
                }
                if limit_kw[m] - top_kw[m] > spare_kw {
                    spare_kw = limit_kw[m] - top_kw[m];
                    shedder = m;
                }
                top_kw[m] = smaller(top_kw[m], need_kw);
            }
            let u: f64 = t.share[part] * top_kw[m];
            let p: f64 = k * u;
            j = 0;
            while j < t.power_knots - 2 && p >= t.power_kw[power_at + j + 1] {
                j += 1;
            }
            x = (p - t.power_kw[power_at + j]) / (t.power_kw[power_at + j + 1] - t.power_kw[power_at + j]);
            let loss: f64 =
                t.loss_kw[loss_at + j] + x * (t.loss_kw[loss_at + j + 1] - t.loss_kw[loss_at + j]);
            let inner_w: f64 = 1000.0 * (p - sign * loss);
            let root: f64 = f64::sqrt(larger(0.0, voltage_v * voltage_v + sign * 4.0 * ohm * inner_w));
            let current_a: f64 = 2.0 * inner_w / (voltage_v + root);
            let after: f64 =
                sign * current_a * t.step_h / (full_ah * (t.soc_max[m] - t.soc_min[m])) + filled[m];
            let mut value: f64 =
                (after - level) * (after - level) - (filled[m] - level) * (filled[m] - level);
            value = balance * value;
            for h in 0..t.low_knots {
                above = larger(0.0, t.low_fill[h] - after);
                below = larger(0.0, t.low_fill[h] - filled[m]);
                above = scarce * (above * above - below * below) / t.low_fill[h];
                value += larger(0.0, weights[reserve + h]) * above;
            }
            // A charge below the inverter loss discharges the cells; the plant sheds what an empty string cannot give.
            value += t.shortfall * larger(0.0, -after);
            above = larger(0.0, after - t.high_fill);
            below = larger(0.0, filled[m] - t.high_fill);
            value += full * (above * above - below * below);
            cost_kw[part] = lost * (loss - t.idle_loss_kw[m]) + heat * ohm * current_a * current_a / 1000.0;
            cost_kw[part] += t.shortfall * (1.0 - k) * u + value * t.energy_kwh[m] / t.step_h;
        }
        if top_kw[m] > 0.0 {
            runs[m] = true;
            c0[m] = cost_kw[0];
            c2[m] = 2.0 * (cost_kw[2] - 2.0 * cost_kw[1] + cost_kw[0]) / (top_kw[m] * top_kw[m]);
            c2[m] = larger(c2[m], t.flattest);
            c1[m] = (cost_kw[2] - cost_kw[0]) / top_kw[m] - c2[m] * top_kw[m];
        }
    }

    // The string with the lowest capability relative to its limit may get a request above its capability.
    let mut base_kw: f64 = 0.0;
    if spare_kw > 0.0 {
        base_kw = top_kw[shedder];
        if base_kw > 0.0 {
            c0[t.strings] = c0[shedder] + base_kw * (c1[shedder] + c2[shedder] * base_kw);
        }
        c1[t.strings] = shed;
        c2[t.strings] = t.shed_slope;
        top_kw[t.strings] = smaller(spare_kw, need_kw - base_kw);
    }

    let mut least: f64 = t.unbounded;
    let mut room_kw: f64 = 0.0;
    for m in 0..t.strings {
        room_kw += top_kw[m];
        request_kw[m] = top_kw[m];
    }
    let mut more: bool = need_kw > 0.0;
    let mut leaver: usize = t.strings;
    let mut everybody: bool = true;
    while more {
        more = false;
        let mut cheapest: f64 = t.unbounded;
        for away in 0..t.strings + 1 {
            let mut tried: bool = false;
            if away == t.strings {
                tried = everybody;
            } else if !everybody {
                tried = runs[away];
            }
            for sheds in 0..2 {
                let mut room_now_kw: f64 = room_kw - top_kw[away];
                if away == t.strings {
                    room_now_kw = room_kw;
                }
                let mut rest_kw: f64 = need_kw;
                let mut possible: bool = tried;
                if sheds == 1 {
                    possible = tried && spare_kw > 0.0;
                    rest_kw = need_kw - base_kw;
                    room_now_kw += top_kw[t.strings];
                    if runs[shedder] && shedder != away {
                        room_now_kw = room_now_kw - top_kw[shedder];
                    }
                }
                if possible && room_now_kw + t.crumbs * plant_kw >= rest_kw {
                    let mut cost: f64 = 0.0;
                    for m in 0..t.strings + 1 {
                        u_kw[m] = 0.0;
                        if m == t.strings {
                            open_[m] = sheds == 1;
                        } else {
                            open_[m] = runs[m] && m != away && !(sheds == 1 && m == shedder);
                        }
                        if open_[m] {
                            cost += c0[m];
                        }
                    }
                    // Equal marginal cost; strings at an end of their range are fixed (Bitran and Hax).
                    let mut unsettled: bool = true;
                    while unsettled {
                        unsettled = false;
                        let mut ease: f64 = 0.0;
                        let mut offset: f64 = rest_kw;
                        for m in 0..t.strings + 1 {
                            if open_[m] {
                                ease += 0.5 / c2[m];
                                offset += 0.5 * c1[m] / c2[m];
                            }
                        }
                        if ease > 0.0 {
                            let mut over: f64 = 0.0;
                            let mut under: f64 = 0.0;
                            for m in 0..t.strings + 1 {
                                if open_[m] {
                                    u_kw[m] = 0.5 * (offset / ease - c1[m]) / c2[m];
                                    over += larger(0.0, u_kw[m] - top_kw[m]);
                                    under += larger(0.0, -u_kw[m]);
                                }
                            }
                            for m in 0..t.strings + 1 {
                                if open_[m] && over > 0.0 && over >= under && u_kw[m] >= top_kw[m] {
                                    u_kw[m] = top_kw[m];
                                    rest_kw = rest_kw - top_kw[m];
                                    open_[m] = false;
                                    unsettled = true;
                                } else if open_[m] && over < under && u_kw[m] <= 0.0 {
                                    u_kw[m] = 0.0;
                                    open_[m] = false;
                                    unsettled = true;
                                }
                            }
                        }
                    }
                    for m in 0..t.strings + 1 {
                        cost += u_kw[m] * (c1[m] + c2[m] * u_kw[m]);
                    }
                    if sheds == 1 {
                        u_kw[shedder] = base_kw + u_kw[t.strings];
                    }
                    if cost < least {
                        least = cost;
                        for m in 0..t.strings {
                            request_kw[m] = u_kw[m];
                        }
                    }
                    if cost < cheapest {
                        cheapest = cost;
                        leaver = away;
                        more = true;
                    }
                }
            }
        }
        if more && !everybody {
            runs[leaver] = false;
            room_kw = room_kw - top_kw[leaver];
        }
        everybody = false;
    }

    // Demand above the total capability is requested within the free inverter power. The rounding remainder
    // goes to a string that is on, so it switches no inverter on.
    let mut missing_kw: f64 = need_kw;
    let mut free_kw: f64 = 0.0;
    let mut largest: usize = 0;
    for m in 0..t.strings {
        missing_kw = missing_kw - request_kw[m];
        free_kw += limit_kw[m] - request_kw[m];
        if request_kw[m] > request_kw[largest] {
            largest = m;
        }
    }
    if missing_kw > t.crumbs * plant_kw && free_kw > 0.0 {
        for m in 0..t.strings {
            request_kw[m] += missing_kw / free_kw * (limit_kw[m] - request_kw[m]);
        }
    } else {
        request_kw[largest] += missing_kw;
    }
    // A remainder below the minimum inverter power goes to the string that is on with the most headroom.
    room_kw = 0.0;
    for m in 0..t.strings {
        request_kw[m] = larger(0.0, smaller(limit_kw[m], request_kw[m]));
        if request_kw[m] >= t.min_power_kw && limit_kw[m] - request_kw[m] > room_kw {
            room_kw = limit_kw[m] - request_kw[m];
            largest = m;
        }
    }
    for m in 0..t.strings {
        if m != largest && request_kw[m] < t.min_power_kw {
            request_kw[largest] += request_kw[m];
            request_kw[m] = 0.0;
        }
    }
    request_kw[largest] = smaller(limit_kw[largest], request_kw[largest]);
    if request_kw[largest] < t.min_power_kw {
        request_kw[largest] = 0.0;
    }
    for m in 0..t.strings {
        request_kw[m] = -sign * request_kw[m];
    }
}
