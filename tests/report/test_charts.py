"""Claims about what charts show: nothing is invented, nothing is lost, and a year stays light."""

import json
from collections import Counter

import numpy as np
import pytest
from bokeh.document import Document
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib.colors import to_rgb
from synthetic import kpis, record, with_reserve

import bess
from bess.report.charts import kpi_figures, operation
from bess.report.data import MAX_CURVES, POINTS_PER_SERIES, TimeAxis, daily, thin
from bess.report.drawing.chart import Chart, background_reach
from bess.report.drawing.interactive import bokeh_document, legend
from bess.report.drawing.style import PALETTE, colours
from bess.simulation.record.dataset import with_initial


@pytest.fixture(scope="module")
def year():
    return record(10, 35_040, price=True)


def series(chart: Chart, panel: int, label: str = ""):
    return [entry for entry in chart.panels[panel].series if entry.label == label or not label]


def test_a_demand_of_zero_has_an_axis_of_a_kilowatt() -> None:
    data = record(2, 96)
    data["demand_kw"][:] = 0.0
    backgrounds = [panel.background for panel in operation.strings(data).panels if panel.background]
    assert backgrounds and all(background_reach(each) == 1.15 for each in backgrounds)


@pytest.mark.parametrize("n_strings", [2, MAX_CURVES + 1])
def test_powers_are_drawn_as_steps_and_states_as_lines(n_strings: int) -> None:
    """A mean power of a step is not one of a ramp to the next."""
    data = record(n_strings, 96)
    data["reactive_kvar"], data["reactive_demand_kvar"] = data["delivered_kw"], data["demand_kw"]
    for chart, panels, kind in (
        (operation.reactive_power(data), (1, 2), "step"),
        (operation.strings(data), (0, 1), "line"),
    ):
        kinds = {each.kind for panel in panels for each in chart.panels[panel].series} - {"band"}
        assert kinds == {kind}


@given(arrays(np.float64, st.integers(1, 400), elements=st.floats(-1e6, 1e6)), st.integers(2, 60))
def test_thinning_keeps_both_ends_and_every_bucket_extreme(values: np.ndarray, limit: int) -> None:
    x, y = thin(np.arange(len(values)), values, limit)
    assert len(y) <= limit + 4 or len(values) <= limit
    np.testing.assert_array_equal(values[x], y)
    assert (y.min(), y.max()) == (values.min(), values.max())
    assert (x[0], x[-1]) == (0, len(values) - 1)
    assert np.all(np.diff(x) > 0)


def ends(chart: Chart, panel: int):
    """Upper and lower end of stacked bands."""
    edges = np.array([entry.y for entry in series(chart, panel)])
    return edges.max(axis=0, initial=0.0), edges.min(axis=0, initial=0.0)


def test_the_height_of_the_power_stack_is_the_request() -> None:
    data = record(2, 192, concentrate=1.0)
    chart = operation.power_split(data)
    for string, panel in ((0, 0), (1, 2)):
        up, down = ends(chart, panel)
        np.testing.assert_allclose((up + down)[:-1], data["request_kw"].values[:, string], atol=1e-9)
        assert np.all(up >= 0.0) and np.all(down <= 0.0)


def test_the_loss_stack_ends_at_inverter_battery_and_hysteresis_loss() -> None:
    data = record(3, 96)
    top = series(operation.power_split(data), 1, "hysteresis loss")[0].y[:-1]
    expected = (data["inverter_loss_kw"] + data["battery_loss_kw"] + data["hysteresis_loss_kw"]).values[:, 0]
    np.testing.assert_allclose(top, expected)


def test_a_string_that_is_asked_for_nothing_is_drawn_at_nothing() -> None:
    data = record(2, 96)
    for name in ("request_kw", "delivered_kw", "derating_loss_kw", "availability_loss_kw"):
        data[name].values[:, 1] = 0.0
    (drawn,) = series(operation.power_split(data), 2)
    np.testing.assert_array_equal(drawn.y, 0.0)


def test_charge_and_discharge_of_a_long_run_do_not_cancel() -> None:
    data = record(6, 40 * 96)
    chart = operation.power_split(data)
    up, down = ends(chart, 0)
    asked = np.abs(data["request_kw"].values).sum()
    assert 96 * (up[:-1].sum() - down[:-1].sum()) == pytest.approx(asked)


def test_states_start_with_the_initial_one() -> None:
    data = record(2, 10)
    assert with_initial(data, "soc").shape == (11, 2)
    line = series(operation.strings(data), 0, "string 1")[0]
    assert line.y[0] == 0.5 and line.y[-1] == data["soc"].values[-1, 1]
    assert line.x[-1] == 2.5


def test_daily_bands_hold_every_value_and_daily_means_the_energy() -> None:
    data = record(2, 40 * 96 + 17)
    values = data["delivered_kw"].values
    edges, low, mean, high = daily(TimeAxis(data), values)
    assert len(edges) == 42 and mean.shape == (41, 2)
    day = np.arange(len(values)) // 96
    assert np.all(values >= low[day]) and np.all(values <= high[day])
    np.testing.assert_allclose((mean[:-1] * 96).sum() + mean[-1].sum() * 17, values.sum())


@pytest.mark.parametrize(
    "make", [operation.strings, operation.power_split, operation.solver_effort, operation.market_dispatch]
)
def test_a_year_of_many_strings_is_light(make, year) -> None:
    chart = make(year)
    sizes = [len(entry.y) for panel in chart.panels for entry in panel.series]
    assert max(sizes) <= POINTS_PER_SERIES + 4
    assert sum(sizes) < 45_000
    assert len(bokeh_document(chart)) < 600_000


@pytest.mark.parametrize("steps", [40, 40 * 96])
def test_many_strings_are_drawn_as_their_spread_and_the_two_that_stand_out_by_name(steps: int) -> None:
    data = record(MAX_CURVES + 20, steps)
    data["soc"][:, 7] = 1.0
    panel = operation.strings(data).panels[0]
    spread, middle, median, high, low = panel.series
    assert len({entry.label for entry in panel.series}) == 5 and high.label == "string 7"
    assert spread.base is not None and middle.base is not None
    assert np.all(spread.base <= middle.base) and np.all(middle.base <= median.y)
    assert np.all(median.y <= middle.y) and np.all(middle.y <= spread.y)
    assert spread.y[-1] == high.y[-1] == 1.0 and low.y.mean() < median.y.mean()


def test_what_was_planned_stands_beside_what_was_delivered() -> None:
    data = record(2, 40 * 96, price=True)
    data["expected_kw"] = data["delivered_kw"].sum("string") * 1.1
    short = operation.market_dispatch(data).panels[2]
    assert short.y_label.startswith("Short of plan")
    delivered = np.abs(data["delivered_kw"].values.sum(axis=1)[:96]).sum()
    assert short.series[0].y[0] == pytest.approx(0.1 * 0.25 * delivered)
    day = operation.market_dispatch(data.isel(time=slice(96)))
    (planned,) = series(day, 1, "planned to be delivered")
    np.testing.assert_allclose(planned.y[:-1], data["expected_kw"].values[:96])


def renderers(chart: Chart):
    """What BokehJS will draw, read back by Bokeh itself: renderers of each panel by name."""
    (root,) = Document.from_json(json.loads(bokeh_document(chart))["doc"]).roots
    return [
        [(entry.name, entry.data_source.data) for entry in plot.renderers if hasattr(entry, "glyph")]
        for plot in root.children
    ]


@pytest.mark.parametrize("steps", [192, 40 * 96])
def test_interactive_data_are_those_of_the_chart(steps: int) -> None:
    chart = operation.strings(record(2, steps))
    first, second = renderers(chart)
    line = series(chart, 0, "string 1")[0]
    np.testing.assert_allclose(dict(first)["string 1"]["string 1"], line.y, rtol=1e-6)
    assert "string 1" in dict(second)
    assert [entry.label for entry in legend(chart)].count("string 1") == 1


EVENT = "[[event]]\nstring = 1\nstart = 2024-01-01T06:00:00+01:00\nend = 2024-01-05T00:00:00Z\n"


def test_every_entry_of_a_legend_hides_all_that_it_names() -> None:
    data = with_reserve(record(2, 96)).assign_attrs(study=EVENT)
    added = {"soc_low": 0.2, "soc_high": 0.8, "frequency_mhz": 0.0, "schedule_kw": 50.0}
    data = data.assign({name: ("time", np.full(96, value)) for name, value in added.items()})
    for chart, expected in (
        (operation.strings(data), {"string 1": 2, "event: string 1 out of service": 2}),
        (operation.power_split(data), {"delivered": 4, "inverter loss": 2}),
        (operation.service(data), {"required window": 2, "scheduled": 1}),
    ):
        document = Document.from_json(json.loads(bokeh_document(chart))["doc"])
        named = Counter(model.name for model in document.models)
        assert {entry.label for entry in legend(chart)} <= set(named)
        assert {name: named[name] for name in expected} == expected


def test_missing_numbers_become_gaps_not_zeros() -> None:
    data = record(1, 8)
    data["solver_gap"][3] = np.nan
    *_, gaps = renderers(operation.solver_effort(data))
    np.testing.assert_array_equal(np.isnan(dict(gaps)["rigorous gap"]["rigorous gap"]), np.arange(8) == 3)


def test_the_same_chart_gives_the_same_document() -> None:
    chart = operation.strings(record(2, 24))
    assert bokeh_document(chart) == bokeh_document(chart)


def test_duration_curves_are_the_sorted_record() -> None:
    data = record(2, 96)
    power, temperature = operation.duration_curves(data).panels
    (delivered,) = (entry for entry in power.series if entry.label == "delivered")
    np.testing.assert_array_equal(delivered.y, np.sort(data["delivered_kw"].values.sum(axis=1))[::-1])
    assert np.all(np.diff(temperature.series[0].y) <= 0.0)
    assert 0.0 < delivered.x[0] < delivered.x[-1] < 100.0


def test_a_single_step_lasts_the_whole_time_of_its_duration_curve() -> None:
    for panel in operation.duration_curves(record(2, 1)).panels:
        for entry in panel.series:
            assert entry.x.tolist() == [0.0, 100.0] and len(set(entry.y.tolist())) == 1


def test_runs_that_did_the_same_are_told_apart() -> None:
    warmer = record(2, 24)
    warmer["temperature_c"] = warmer["temperature_c"] + 1.0
    runs = {"a": record(2, 24), "b": record(2, 24), "c": record(2, 24, concentrate=1.0), "d": warmer}
    lines = operation.mean_temperature(runs).panels[0].series[:4]
    assert [(line.label, line.dashed) for line in lines] == [
        ("a", False), ("b (as a)", True), ("c", False), ("d", False),
    ]  # fmt: skip


def test_events_are_marked_where_they_were_and_no_longer() -> None:
    data = record(2, 96)
    data.attrs["study"] = EVENT
    (span,) = operation.strings(data).spans
    assert (span.start, span.end, span.label) == (5.0, 24.0, "string 1 out of service")


def test_the_energy_of_a_day_is_that_of_its_steps() -> None:
    data = record(2, 40 * 96, price=True)
    sold, bought = operation.market_dispatch(data).panels[1].series
    delivered = data["delivered_kw"].values[:96]
    assert sold.y[0] == pytest.approx(0.25 * delivered[delivered > 0].sum())
    assert bought.y[0] == pytest.approx(0.25 * delivered[delivered < 0].sum())


def test_steps_that_fell_back_are_marked() -> None:
    data = record(2, 192)
    marked = series(operation.solver_effort(data), 0, "fallback")[0]
    assert len(marked.x) == int(data["fallback"].sum()) == 2


def test_derating_gains_of_the_system_follow_its_table() -> None:
    own = operation.derating_curves(bess.System.reference()).panels[0].series
    law, table = own[1], own[-1]
    np.testing.assert_allclose(np.interp(table.x, law.x, law.y), table.y, atol=0.01)
    assert np.all(own[0].y >= law.y - 1e-12) and np.all(own[2].y <= law.y + 1e-12)


def test_the_front_is_drawn_without_dominated_points_and_with_its_knee() -> None:
    base = kpis(record(2, 8))
    points = {"a": (98.0, 98.0), "b": (98.8, 97.8), "c": (99.0, 97.0), "bad": (98.1, 97.1)}
    named = {
        n: base | {"battery_efficiency_pct": x, "inverter_efficiency_pct": y} for n, (x, y) in points.items()
    }
    chart = kpi_figures.pareto_front(named)
    assert series(chart, 0, "front")[0].x.tolist() == [98.0, 98.8, 99.0]
    assert series(chart, 0, "dominated")[0].x.tolist() == [98.1]
    assert series(chart, 0, "knee: b")[0].y.tolist() == [97.8]


def test_kpis_over_a_parameter_are_in_the_order_of_the_parameter() -> None:
    base = kpis(record(2, 8))
    named = {str(w): base | {"inverter_efficiency_pct": 97.0 + w} for w in (1.0, 0.0, 0.5)}
    (panel,) = kpi_figures.kpi_lines(named, [1.0, 0.0, 0.5], "weight").panels
    assert panel.title == "Inverter efficiency", "the others do not change"
    line = panel.series[0]
    assert line.x.tolist() == [0.0, 0.5, 1.0] and line.y.tolist() == [97.0, 97.5, 98.0]


# Machado, Oliveira, Fernandes, "A physiologically-based model for simulation of color vision
# deficiency", 2009.
DEFICIENCIES = {
    "none": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881],
    ],
}  # fmt: skip


@pytest.mark.parametrize("matrix", DEFICIENCIES.values(), ids=DEFICIENCIES)
def test_colour_blind_readers_can_tell_the_palette_apart(matrix) -> None:
    linear = np.array([to_rgb(colour) for colour in PALETTE]) ** 2.2
    seen = np.clip(linear @ np.array(matrix).T, 0.0, 1.0) ** (1 / 2.2)
    distance = np.linalg.norm(seen[:, None] - seen[None], axis=2) + np.eye(len(seen))
    assert distance.min() > 0.12


def test_every_string_has_a_colour_of_its_own() -> None:
    assert all(len(set(colours(count))) == count for count in (1, 2, 7, 8, 32))


def test_the_state_of_health_starts_where_the_strings_do_and_wear_adds_up() -> None:
    data = record(2, 10)
    left = 1.0 - 1e-4 * np.arange(1, 11)[:, None] * [1.0, 2.0]
    worn = {
        "soh_capacity": (("time", "string"), left),
        "soh_resistance": (("time", "string"), 1.0 / left),
        "wear_eur": (("time", "string"), np.full((10, 2), 0.5)),
    }
    new = {key: [1.0, 1.0] for key in ("initial_soh_capacity", "initial_soh_resistance")}
    chart = operation.state_of_health(data.assign(worn).assign_attrs(new))
    capacity, cost = (series(chart, panel, "string 1")[0] for panel in (0, 2))
    assert capacity.y[0] == 100.0 and capacity.y[-1] == pytest.approx(99.8)
    assert cost.y[0] == 0.0 and cost.y[-1] == 5.0
