"""Claims about the dispatch that asks the plant."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import bess
from bess.dispatch import (
    Arbitrage,
    DispatchInputs,
    DynamicProgramDispatch,
    ExternalForecast,
    PerfectForecast,
)
from bess.system.terms import SettlementTerms

PRICES = Path(__file__).parents[3] / "shared/data/prices/smard_de_viertelstunde_2024_berechnet_resaved.csv"
WAVE = 60.0 - 40.0 * np.cos(np.arange(144) * 0.25 * 2 * np.pi / 12.0)


def with_wear(**wear: Any) -> bess.System:
    return bess.System(bess.System.reference(2).document | {"wear": wear})


def in_the_plant(system: bess.System, state: bess.State, demand_kw: np.ndarray) -> Any:
    """What the plant makes of a demand that is split in proportion to nominal power."""
    share = system.nominal_kw / system.nominal_kw.sum()
    return bess.Plant(system, state).run(demand_kw[:, None] * share)


@pytest.mark.parametrize(("soc", "temperature_c"), [(0.5, 25.0), (0.02, 10.0), (0.97, 43.0)])
def test_the_plant_delivers_what_a_plan_expects(soc: float, temperature_c: float) -> None:
    """Energies within one per cent, and the income with them; nearly all that is asked for."""
    system = bess.System.reference(2)
    state = bess.State([soc] * 2, [temperature_c] * 2)
    plan = bess.plan_dispatch(system, WAVE, state)
    delivered_kw = in_the_plant(system, state, plan.demand_kw).delivered_kw.sum(axis=1)
    assert np.abs(plan.demand_kw).sum() * 0.25 > 1000.0
    assert np.abs(delivered_kw).sum() > 0.97 * np.abs(plan.demand_kw).sum()
    assert np.abs(delivered_kw - plan.expected_delivered_kw).sum() < 0.01 * np.abs(plan.demand_kw).sum()
    missing_eur = (np.abs(plan.demand_kw) - np.abs(delivered_kw)) @ (WAVE + 50.0) * 0.25e-3
    assert delivered_kw @ WAVE * 0.25e-3 - missing_eur == pytest.approx(plan.expected_net_eur, rel=0.03)


def test_a_plan_is_the_same_to_the_last_bit_whatever_was_planned_before() -> None:
    system = bess.System.reference(2)
    state = bess.State([0.3, 0.6], [25.0, 40.0])
    fresh, used = (DynamicProgramDispatch(system, 0.25, SettlementTerms()) for _ in range(2))
    day = np.arange(144) // 96
    inputs = DispatchInputs(WAVE, np.full(144, 25.0), day)
    used.plan(
        DispatchInputs(WAVE[::-1].copy(), np.full(144, 5.0), day),
        bess.State([0.9, 0.9], [20.0, 20.0], [0.8, 0.9]),
    )
    first, second = fresh.plan(inputs, state), used.plan(inputs, state)
    np.testing.assert_array_equal(first.demand_kw, second.demand_kw)
    assert first.expected_net_eur == second.expected_net_eur


def test_flat_prices_are_no_reason_to_cycle() -> None:
    system = bess.System.reference(2)
    plan = bess.plan_dispatch(system, np.full(144, 80.0), system.initial_state())
    assert np.abs(np.minimum(plan.demand_kw, 0.0)).sum() == 0.0


@pytest.mark.parametrize("model", ["throughput", "nmc-a-75ah"])
def test_higher_wear_cost_means_fewer_cycles(model: str) -> None:
    """Of what is charged: the last discharge leaves the less, the less a kWh left is worth."""
    charged = []
    for price in (0.0, 30.0, 90.0):
        key = {"eur_per_mwh": price} if model == "throughput" else {"replacement_eur_kwh": 2.0 * price}
        system = with_wear(model=model, **key)
        plan = bess.plan_dispatch(system, WAVE, bess.State([0.1, 0.1], [25.0, 25.0]))
        charged.append(-np.minimum(plan.demand_kw, 0.0).sum())
    assert charged[0] > 1.02 * charged[1] > 1.1 * charged[2]


def test_a_fee_is_a_reason_to_trade_less() -> None:
    system, state = bess.System.reference(2), bess.State([0.1, 0.1], [25.0, 25.0])
    free, dear = (
        bess.plan_dispatch(system, WAVE, state, terms=SettlementTerms(charge_fee_eur_mwh=fee))
        for fee in (0.0, 60.0)
    )
    assert np.abs(dear.demand_kw).sum() < 0.7 * np.abs(free.demand_kw).sum()
    assert dear.expected_net_eur < free.expected_net_eur


def test_at_negative_prices_the_plan_ends_full_and_earns_at_least_what_charging_does() -> None:
    system, state = bess.System.reference(2), bess.State([0.9, 0.9], [25.0, 25.0])
    price = np.r_[np.full(24, 50.0), np.full(24, -200.0), np.full(48, 40.0)]
    plan = bess.plan_dispatch(system, price, state, hours=24)
    assert plan.expected_energy_kwh[47] > 0.95 * plan.expected_energy_kwh.max()
    income_eur = (plan.expected_delivered_kw * price)[24:48].sum() * 0.25 / 1000.0
    assert income_eur > 0.2 * system.nominal_energy_kwh.sum()


@pytest.mark.parametrize(("wear_eur_mwh", "fee_eur_mwh"), [(31.0, 0.0), (0.0, 35.0)])
def test_a_cycle_can_pay_although_its_discharge_alone_does_not(
    wear_eur_mwh: float, fee_eur_mwh: float
) -> None:
    """Charging earns 60 EUR/MWh at noon; discharging costs 1 or 5, with wear or the fee."""
    hour = np.arange(96) // 4
    price = np.where((hour >= 10) & (hour < 15), -60.0, 30.0)
    plan = bess.plan_dispatch(
        with_wear(model="throughput", eur_per_mwh=wear_eur_mwh) if wear_eur_mwh else bess.System.reference(2),
        price,
        bess.State([0.9, 0.9], [25.0, 25.0]),
        hours=24,
        terms=SettlementTerms(discharge_fee_eur_mwh=fee_eur_mwh),
    )
    assert plan.demand_kw[:40].max() > 50.0
    assert plan.demand_kw[40:60].min() < -50.0
    assert plan.expected_net_eur > 20.0


@pytest.mark.independent
@pytest.mark.parametrize("seed", range(6))
def test_where_cycles_are_few_a_plan_earns_about_as_much_as_a_linear_program(seed: int) -> None:
    """In the plant, over 12 hours of noisy prices. Of 150 other draws two earned 93 to 94 %; median 98 %."""
    rng = np.random.default_rng(seed)
    hour, energy_kwh, soc = np.arange(48) * 0.25, 180.0, rng.uniform(0.1, 0.9)
    price = (
        90.0 + 45.0 * np.sin(2.0 * np.pi * hour / 12.0 + rng.uniform(0.0, 6.3)) + rng.normal(0.0, 20.0, 48)
    )
    system, state = bess.load_system("cornejo-180"), bess.State([soc], [25.0])
    one_day, limits = np.zeros(48, dtype=np.int64), {"cycles_per_plan": 0.75}
    aware = DynamicProgramDispatch(system, 0.25, SettlementTerms(), max_energy_kwh=energy_kwh, **limits)
    linear = Arbitrage(
        PerfectForecast(price), one_day, power_kw=180.0, energy_kwh=energy_kwh, look_ahead_h=12.0, **limits
    )
    inputs = DispatchInputs(price, np.full(48, 25.0), one_day, is_last=True)
    earned = []
    for demand_kw in (aware.plan(inputs, state).demand_kw, linear.plan(0, soc * energy_kwh)):
        flows = bess.Plant(system, state, plant_step_s=60.0).run(demand_kw[:, None], step_s=900.0)
        earned.append(float(flows.delivered_kw[:, 0] @ price))
    assert earned[0] > 0.94 * earned[1]


def test_a_plan_stays_within_cycles_power_and_energy() -> None:
    system, state = bess.System.reference(2), bess.State([0.0, 0.0], [25.0, 25.0])
    inputs = DispatchInputs(WAVE, np.full(144, 25.0), np.zeros(144, dtype=np.int64))
    dispatch = DynamicProgramDispatch(
        system, 0.25, SettlementTerms(), max_power_kw=100.0, max_energy_kwh=200.0, cycles_per_day=1.0
    )
    plan = dispatch.plan(inputs, state)
    assert np.abs(plan.demand_kw).max() <= 100.0 + 1e-9
    assert plan.expected_energy_kwh.max() < 203.0
    drawn = -np.minimum(np.diff(plan.expected_energy_kwh, prepend=0.0), 0.0)
    assert 150.0 < drawn.sum() < 203.0


@pytest.mark.parametrize("cycles", [0.3, 1.5])
def test_what_remains_of_a_budget_is_for_the_whole_plan_not_for_each_of_its_days(cycles: float) -> None:
    system, hours = bess.System.reference(2), np.arange(192) * 0.25
    price = 60.0 - 40.0 * np.cos(hours * 2.0 * np.pi / 12.0) + hours
    dispatch = DynamicProgramDispatch(system, 0.25, SettlementTerms(), cycles_per_day=1.0)
    remaining_kwh = cycles * float(system.nominal_energy_kwh.sum())
    inputs = DispatchInputs(price, np.full(192, 20.0), np.arange(192) // 96, remaining_kwh=remaining_kwh)
    plan = dispatch.plan(inputs, bess.State([0.05] * 2, [25.0] * 2))
    drawn_kwh = np.maximum(-np.diff(plan.expected_energy_kwh), 0.0).sum()
    assert 0.8 * remaining_kwh < drawn_kwh < 1.01 * remaining_kwh


def test_the_limits_of_the_grid_connection_hold_in_each_direction() -> None:
    system, state = bess.System.reference(2), bess.State([0.5, 0.5], [25.0, 25.0])
    inputs = DispatchInputs(WAVE, np.full(144, 25.0), np.zeros(144, dtype=np.int64))
    dispatch = DynamicProgramDispatch(
        system, 0.25, SettlementTerms(), max_import_kw=60.0, max_export_kw=120.0
    )
    demand_kw = dispatch.plan(inputs, state).demand_kw
    assert -60.0 - 1e-9 <= demand_kw.min() < -59.0
    assert 61.0 < demand_kw.max() <= 120.0 + 1e-9


def test_a_string_out_of_service_is_not_planned_with() -> None:
    system = bess.System.reference(2)
    inputs = DispatchInputs(WAVE, np.full(144, 25.0), np.arange(144) // 96)
    dispatch = DynamicProgramDispatch(system, 0.25, SettlementTerms())
    plan = dispatch.plan(inputs, system.initial_state(), limit_kw=np.array([92.0, 0.0]))
    assert 80.0 < np.abs(plan.demand_kw).max() <= 92.0 + 1e-9
    nothing = dispatch.plan(inputs, system.initial_state(), limit_kw=np.zeros(2))
    assert not nothing.demand_kw.any() and np.isfinite(nothing.expected_energy_kwh).all()


@pytest.mark.parametrize("model", ["none", "nmc-a-75ah"])
def test_a_plant_without_a_string_is_planned_as_the_plant_of_the_others(model: str) -> None:
    """Neither the energy nor the temperature of a string out of service counts, nor its ageing."""
    inputs = DispatchInputs(WAVE, np.full(144, 25.0), np.arange(144) // 96)
    plans = []
    for soc, temperature_c, limit_kw in (([0.3], [28.0], [92.0]), ([0.3, 0.9], [28.0, 45.0], [92.0, 0.0])):
        document = bess.System.reference(len(soc)).document | {"wear": {"model": model}}
        dispatch = DynamicProgramDispatch(bess.System(document), 0.25, SettlementTerms())
        state = bess.State(soc, temperature_c)
        plans.append(dispatch.plan(inputs, state, limit_kw=np.array(limit_kw)))
    np.testing.assert_allclose(plans[1].demand_kw, plans[0].demand_kw, atol=1e-6)
    np.testing.assert_allclose(plans[1].expected_energy_kwh, plans[0].expected_energy_kwh, atol=1e-6)


def test_a_plant_that_is_too_hot_is_left_to_cool() -> None:
    """At 75 degC nothing is delivered: asking would only cost."""
    system = bess.System.reference(2)
    plan = bess.plan_dispatch(system, WAVE, bess.State([0.5, 0.5], [75.0, 75.0]), hours=36)
    missing = np.abs(plan.demand_kw) - np.abs(plan.expected_delivered_kw)
    assert missing.sum() <= 0.05 * np.abs(plan.demand_kw).sum()


def test_the_last_plan_of_a_run_empties_the_store() -> None:
    system, state = bess.System.reference(2), bess.State([0.5, 0.5], [25.0, 25.0])
    last, other = (
        DynamicProgramDispatch(system, 0.25, SettlementTerms()).plan(
            DispatchInputs(np.full(48, 50.0), np.full(48, 25.0), np.zeros(48, dtype=np.int64), is_last=end),
            state,
        )
        for end in (True, False)
    )
    assert last.expected_energy_kwh[-1] < 0.05 * system.nominal_energy_kwh.sum()
    assert other.expected_energy_kwh[-1] > 0.4 * system.nominal_energy_kwh.sum()


def flat_system() -> bess.System:
    """One string of constant voltage and resistance that does not warm: its losses are a curve over power."""
    document = bess.System.reference(1).document
    battery = document["battery"] | {
        "ocv_v": {"soc": [0.0, 1.0], "charge": [3.7, 3.7], "discharge": [3.7, 3.7]},
        "resistance_temperature": {"temperature_c": [25.0, 26.0], "resistance_mohm": [4.0, 4.0]},
        "resistance_soc": {"soc": [0.0, 0.1], "resistance_mohm": [4.0, 4.0]},
    }
    thermal = document["thermal"] | {"lumped": {"k1_k_per_j": 1e-12, "k2_per_s": 0.0}}
    return bess.System(document | {"battery": battery, "thermal": thermal})


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(4))
def test_a_plan_earns_what_dynamic_programming_finds(seed: int) -> None:
    """Oracle: values over a grid of stored energy, every power with its true loss, no linear program."""
    system = flat_system()
    rng = np.random.default_rng(seed)
    price = np.repeat(rng.normal(60.0, 40.0, 12), 4)
    price = np.maximum(price, 1.0)
    state = bess.State([0.5], [25.0])
    power = np.linspace(-92.0, 92.0, 185)
    inverter = system.strings[0].inverter
    load = np.abs(power) / 92.0
    loss = 92.0 * np.where(
        power < 0, np.interp(load, inverter.load, inverter.loss_charge),
        np.interp(load, inverter.load, inverter.loss_discharge),
    ) * (power != 0.0)  # fmt: skip
    volt, ohm = 3.7 * 192, 4e-3 * 192 / 4
    dc_w = 1e3 * (power + loss)
    drawn_kwh = volt * (volt - np.sqrt(volt**2 - 4 * ohm * dc_w)) / (2 * ohm) * 0.25e-3
    capacity = volt * 376.0 * 1e-3
    grid = np.linspace(0.0, capacity, 1201)
    after = grid[:, None] - drawn_kwh
    inside = (after >= -1e-9) & (after <= capacity + 1e-9)
    value = np.zeros(grid.size)
    for each in price[::-1]:
        gain = power * each * 0.25e-3 + np.interp(after, grid, value)
        value = np.where(inside, gain, -np.inf).max(axis=1)
    best_eur = float(np.interp(0.5 * capacity, grid, value))

    inputs = DispatchInputs(price, np.full(48, 25.0), np.zeros(48, dtype=np.int64), is_last=True)
    plan = DynamicProgramDispatch(system, 0.25, SettlementTerms(), cycles_per_day=99.0).plan(inputs, state)
    assert plan.expected_net_eur <= best_eur * 1.001
    assert plan.expected_net_eur >= best_eur * 0.99  # of 140 other draws one has 0.9887; median 0.998


def test_a_longer_look_ahead_earns_no_less(tmp_path: Path) -> None:
    """Six days on which heat and energy are short: with linear programs 96 h earned 0.8 % less than 24 h."""
    hours = pd.date_range("2024-06-01", periods=144, freq="1h", tz="UTC")
    rng = np.random.default_rng(5)
    price = 60.0 + 50.0 * np.sin(np.arange(144) * 2 * np.pi / 8.0) + rng.normal(0.0, 15.0, 144)
    file = tmp_path / "prices.csv"
    pd.DataFrame({"time": hours.strftime("%Y-%m-%dT%H:%M:%SZ"), "DE-LU": price}).to_csv(file, index=False)
    values = {"demand.prices": str(file), "policy.name": "equal", "wear.model": "none"}
    day, days = (
        bess.run(
            bess.load_study("arbitrage-2024", values | {"demand.look_ahead_h": look_h}), progress=False
        ).kpis
        for look_h in (24.0, 96.0)
    )
    assert days["net_eur"] > 0.997 * day["net_eur"]
    assert min(day["fulfilment_pct"], days["fulfilment_pct"]) > 99.0


def test_a_forecast_from_a_file_knows_the_present_only() -> None:
    ahead = ExternalForecast([1.0, 2.0, 3.0], [10.0, 20.0, 30.0]).ahead(1, 5)
    assert ahead.tolist() == [2.0, 30.0]
    with pytest.raises(bess.InputError, match="forecast of 2 steps does not fit a series of 3"):
        ExternalForecast([1.0, 2.0, 3.0], [1.0, 2.0])


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"prices": np.ones(10)}, "10 values are less than the 144 steps"),
        ({"prices": np.r_[np.ones(143), np.nan]}, "prices at index 143 is nan"),
        ({"prices": pd.Series(np.ones(200))}, "time-zone aware index"),
        ({"hours": 0.1}, "hours"),
        ({"ambient_c": [1.0, 2.0]}, "give one value, or one for each of 144 steps"),
    ],
)
def test_bad_input_is_refused(arguments: dict[str, Any], match: str) -> None:
    system = bess.System.reference(2)
    given = {"prices": WAVE, "state": system.initial_state()} | arguments
    with pytest.raises(bess.InputError, match=match):
        bess.plan_dispatch(system, **given)


def test_a_series_of_hours_is_held_over_the_steps() -> None:
    system = bess.System.reference(2)
    times = pd.date_range("2024-06-01", periods=36, freq="1h", tz="UTC")
    hourly = pd.Series(WAVE[::4], index=times)
    quarter = pd.Series(np.repeat(WAVE[::4], 4), index=pd.date_range(times[0], periods=144, freq="15min"))
    plans = [bess.plan_dispatch(system, series, system.initial_state()) for series in (hourly, quarter)]
    np.testing.assert_array_equal(plans[0].demand_kw, plans[1].demand_kw)


@pytest.mark.skipif(not PRICES.exists(), reason="real data are not beside the repository (../shared/data)")
def test_a_week_of_real_prices_nets_more_than_the_plan_with_a_constant_efficiency() -> None:
    values = {
        "demand.prices": str(PRICES),
        "policy.name": "equal",
        "run.days": 7,
        "wear.model": "throughput",
        "wear.eur_per_mwh": 20.0,
    }
    runs = {
        plan: bess.run(bess.load_study("arbitrage-2024", values | {"demand.plan": plan}), progress=False)
        for plan in ("aware", "linear")
    }
    aware, linear = runs["aware"].kpis, runs["linear"].kpis
    assert aware["net_eur"] > linear["net_eur"] + 20.0
    assert aware["fulfilment_pct"] > 98.0 > linear["fulfilment_pct"]
    assert aware["imbalance_kwh"] < 0.02 * aware["demand_kwh"] < linear["imbalance_kwh"]
    record = runs["aware"].dataset
    gap = record["expected_kw"].values - record["delivered_kw"].values.sum(axis=1)
    assert aware["imbalance_kwh"] == pytest.approx(np.abs(gap).sum() * 0.25)


@pytest.mark.parametrize("plan", ["aware", "linear"])
def test_cycles_of_a_plan_are_the_mean_of_what_is_charged_and_discharged(plan: str) -> None:
    from bess.dispatch import Arbitrage, PerfectForecast

    system, state = bess.System.reference(2), bess.State([0.0, 0.0], [25.0, 25.0])
    limits = {"cycles_per_plan": 0.5}
    if plan == "aware":
        dispatch = DynamicProgramDispatch(system, 0.25, SettlementTerms(), max_energy_kwh=400.0, **limits)
        inputs = DispatchInputs(WAVE[:96], np.full(96, 25.0), np.zeros(96, dtype=np.int64), is_last=True)
        demand_kw = dispatch.plan(inputs, state).demand_kw
    else:
        arbitrage = Arbitrage(
            PerfectForecast(WAVE[:96]),
            np.zeros(96),
            power_kw=184.0,
            energy_kwh=400.0,
            look_ahead_h=24.0,
            **limits,
        )
        demand_kw = arbitrage.plan(0, 0.0)
    assert 190.0 < np.abs(demand_kw).sum() * 0.25 / 2.0 < 200.1


def test_the_remaining_energy_has_the_given_value() -> None:
    system, state = bess.System.reference(2), bess.State([0.5, 0.5], [25.0, 25.0])
    inputs = DispatchInputs(np.full(48, 50.0), np.full(48, 25.0), np.zeros(48, dtype=np.int64))
    left = [
        DynamicProgramDispatch(system, 0.25, SettlementTerms(), end_price_eur_mwh=price)
        .plan(inputs, state)
        .expected_energy_kwh[-1]
        for price in (0.0, 50.0, 90.0)
    ]
    assert left[0] < 30.0 < 200.0 < left[1] < 300.0 < left[2]


@pytest.mark.parametrize("r_scale", [1.0, 3.0])
def test_a_plan_tapers_the_charge_of_cells_with_a_voltage_limit(r_scale: float) -> None:
    """Nothing is asked for that the limit does not let in, and yet the store gets nearly full."""
    document = bess.load_system("cornejo-180").document
    document["battery"]["r_scale"] = r_scale
    system = bess.System(document)
    price = np.repeat([10.0, 200.0], 24)
    state = bess.State([0.5], [25.0])
    plan = bess.plan_dispatch(system, price, state, hours=12)
    charging = plan.demand_kw[:24] < 0.0
    plant = in_the_plant(system, state, plan.demand_kw)
    delivered_kw = plant.delivered_kw.sum(axis=1)
    assert np.abs(delivered_kw - plan.demand_kw)[:24].max() < 0.01 * 180.0
    assert plan.expected_energy_kwh.max() > 0.96 * system.nominal_energy_kwh.sum()
    # Without a limit in the plan the plant would have cut it.
    flat_out = np.where(charging, -180.0, 0.0)
    cut = in_the_plant(system, state, np.r_[flat_out, np.zeros(24)])
    assert (np.abs(cut.delivered_kw.sum(axis=1)) < 179.0)[:24][charging].any()
