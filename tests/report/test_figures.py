"""Claims about figures: they draw for any number of strings, say their units, and hide no data."""

from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from folders import write_run
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from synthetic import kpis, record, with_reserve

import bess
from bess.errors import InputError
from bess.report import figures, save_figure, write_report
from bess.report.drawing.style import styled

PLAIN = ("SOC", "Mean SOC", "Nodes", "String", "Derating factor", "Node (0 = air inlet)", "string", "")


def of_one_run(n_strings: int) -> dict[str, Callable[[], Figure]]:
    data = record(n_strings, 96, concentrate=0.9, nodes=5, price=True)
    times = np.random.default_rng(0).lognormal(-4, 0.5, 96)
    return {
        "strings": lambda: figures.strings(data),
        "string_spread": lambda: figures.string_spread(data),
        "mean_temperature": lambda: figures.mean_temperature(data),
        "power_split": lambda: figures.power_split(data),
        "inverter_pattern": lambda: figures.inverter_pattern(data),
        "node_temperatures": lambda: figures.node_temperatures(data),
        "solver_effort": lambda: figures.solver_effort(data, times),
        "market_dispatch": lambda: figures.market_dispatch(data),
        "kpi_bars": lambda: figures.kpi_bars({"": kpis(data)}),
        "energy_flow": lambda: figures.energy_flow(data),
        "duration_curves": lambda: figures.duration_curves(data),
    }


def of_scenarios() -> dict[str, Callable[[], Figure]]:
    runs = {name: record(2, 96, concentrate=c) for name, c in (("S1", 1.0), ("S2", 0.5), ("S3", 0.0))}
    named = {name: kpis(data) for name, data in runs.items()}
    return {
        "kpi_bars": lambda: figures.kpi_bars(named),
        "kpi_radar": lambda: figures.kpi_radar(named),
        "losses_compared": lambda: figures.losses_compared(named),
        "duration_curves": lambda: figures.duration_curves(runs),
        "mean_temperature": lambda: figures.mean_temperature(runs),
        "string_spread": lambda: figures.string_spread(runs),
        "pareto_front": lambda: figures.pareto_front(named),
        "kpi_lines": lambda: figures.kpi_lines(named, [0.0, 0.5, 1.0], "battery weight"),
        "derating_curves": lambda: figures.derating_curves(bess.System.reference()),
    }


CASES = [(f"{name}-{count}", make) for count in (1, 2, 9, 32) for name, make in of_one_run(count).items()]
CASES += list(of_scenarios().items())


def test_the_lowest_panel_of_each_column_has_numbers_on_its_axis() -> None:
    base = kpis(record(2, 8))
    keys = ["inverter_efficiency_pct", "battery_efficiency_pct", "system_efficiency_pct"]
    named = {str(w): base | dict.fromkeys(keys, 97.0 + w) for w in (0.0, 0.5, 1.0)}
    figure = figures.kpi_lines(named, [0.0, 0.5, 1.0], "weight", keys)
    FigureCanvasAgg(figure).draw()
    shown = [any(t.get_visible() for t in axes.get_xticklabels()) for axes in figure.axes]
    assert shown == [False, True, True]


@pytest.mark.parametrize("make", [make for _, make in CASES], ids=[name for name, _ in CASES])
def test_a_figure_draws_with_units_and_a_legend_that_covers_no_axes(make: Callable[[], Figure]) -> None:
    figure = make()
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    data_areas = [axes.get_window_extent(renderer) for axes in figure.axes]
    for legend in figure.legends:
        box = legend.get_window_extent(renderer)
        assert not any(box.overlaps(area) for area in data_areas)
        assert box.x0 >= 0 and box.x1 <= figure.bbox.x1
    for axes in figure.axes:
        assert axes.get_legend() is None
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert (
                "(" in label
                or "%" in label
                or label == "°C"
                or label in PLAIN
                or label.startswith(("Hours", "battery"))
            )


@pytest.mark.parametrize("name", ["strings-2", "node_temperatures-1", "kpi_radar"])
def test_the_same_figure_is_saved_as_the_same_bytes(name: str, tmp_path: Path) -> None:
    make = dict(CASES)[name]
    first = [path.read_bytes() for path in save_figure(make(), tmp_path / "a.svg")]
    second = [path.read_bytes() for path in save_figure(make(), tmp_path / "b.png")]
    assert first == second
    assert [content[:4] for content in first] == [b"<?xm", b"\x89PNG", b"%PDF"]


def test_a_file_name_with_a_dot_keeps_its_name(tmp_path: Path) -> None:
    svg, png, pdf = save_figure(Figure(), tmp_path / "w=0.5")
    assert (svg.name, png.name, pdf.name) == ("w=0.5.svg", "w=0.5.png", "w=0.5.pdf")


def test_a_notebook_that_turns_interactive_at_its_first_figure_stays_so() -> None:
    @styled()
    def first() -> Figure:
        mpl.interactive(True)  # as the backend of notebooks does
        return Figure()

    with mpl.rc_context():
        mpl.interactive(False)
        first()
        assert mpl.is_interactive()


def test_a_notebook_shows_a_figure_that_pyplot_does_not_know() -> None:
    assert figures.strings(record(2, 8))._repr_png_().startswith(b"\x89PNG")


def test_settings_of_the_caller_are_left_alone() -> None:
    with mpl.rc_context():
        mpl.rcParams["font.size"] = 23.0
        before = dict(mpl.rcParams)
        figures.strings(record(2, 8))
        assert dict(mpl.rcParams) == before


def test_the_radar_reaches_out_for_the_best_and_in_for_the_worst() -> None:
    base = kpis(record(2, 8))
    named = {
        "hot": base | {"peak_mean_temperature_c": 51.0},
        "cool": base | {"peak_mean_temperature_c": 45.0},
    }
    axes = figures.kpi_radar(named).axes[0]
    radius = {line.get_label(): line.get_ydata()[5] for line in axes.lines}
    assert radius == {"hot": 0.25, "cool": 1.0}
    assert any("best 45.0 °C\nworst 51.0 °C" in text.get_text() for text in axes.texts)


def test_bars_show_the_values_of_the_kpis() -> None:
    named = {"": kpis(record(2, 96))}
    axes = figures.kpi_bars(named).axes[0]
    tops = [bar.get_y() + bar.get_height() for bar in axes.patches]
    np.testing.assert_allclose(tops, [named[""][key] for key in list(named[""])[:5]])


def test_the_flow_leads_from_the_grid_through_the_store_and_back_on_an_axis_from_zero() -> None:
    data = record(2, 192, concentrate=1.0)
    values = kpis(data)
    axes = figures.energy_flow(data).axes[0]
    assert axes.get_xlim()[0] == 0.0
    bars = [(text.get_text(), bar) for text, bar in zip(axes.get_yticklabels(), axes.patches, strict=True)]
    ends = dict(bars)
    assert ends["Grid import"].get_width() == pytest.approx(values["charged_kwh"])
    assert ends["Grid export"].get_width() == pytest.approx(values["discharged_kwh"])
    cells = [bar.get_width() for label, bar in bars if label == "Batteries"]
    assert len(cells) == 2 and sum(cells) == pytest.approx(values["battery_loss_kwh"])
    # The losses of charging fill what is between the energy taken and that put into store.
    labels = [label for label, _ in bars]
    between = bars[labels.index("Grid import") + 1 : labels.index("Stored")]
    stored = ends["Grid import"].get_width() - sum(bar.get_width() for _, bar in between)
    assert len(between) == 3 and stored == pytest.approx(ends["Stored"].get_width())


def test_the_flow_of_a_run_that_was_asked_for_nothing_has_an_axis() -> None:
    nothing = record(2, 96) * 0.0
    nothing.attrs = record(2, 96).attrs
    assert figures.energy_flow(nothing).axes[0].get_xlim() == (0.0, 1.0)


def test_bars_of_losses_are_as_long_as_their_sum() -> None:
    named = {name: kpis(record(2, 96, concentrate=share)) for name, share in (("a", 0.0), ("b", 1.0))}
    axes = figures.losses_compared(named).axes[0]
    ends = [0.0, 0.0]
    for index, bar in enumerate(axes.patches):
        ends[index % 2] = max(ends[index % 2], bar.get_x() + bar.get_width())
    parts = ("lost_kwh", "unmet_kwh", "hysteresis_loss_kwh")
    assert ends == pytest.approx([sum(entry[part] for part in parts) for entry in named.values()])


def test_months_add_up_to_the_year() -> None:
    data = record(2, 100 * 96, price=True).assign_attrs(step_h=0.25)
    values = bess.kpis(data)
    money, energy, *_ = figures.monthly_bars(data).axes
    net = money.lines[0].get_ydata()
    assert len(net) == 4 and net.sum() == pytest.approx(values["net_eur"])
    discharged = [bar.get_height() for bar in energy.containers[0]]
    assert sum(discharged) == pytest.approx(values["discharged_kwh"] / 1000.0)


def test_months_of_a_service_show_what_it_is_paid_for_its_reserve() -> None:
    money, *_ = figures.monthly_bars(with_reserve(record(2, 960, price=True)).assign_attrs(step_h=0.25)).axes
    net = money.lines[0].get_ydata()
    drawn = sum(bar.get_height() for bars in money.containers for bar in bars)
    assert drawn == pytest.approx(net.sum())


def test_a_map_has_every_step_in_its_day_and_hour() -> None:
    data = record(2, 20 * 96)
    shifted = data.assign_coords(time=data["time"] + np.timedelta64(6, "h"))
    image = np.asarray(figures.heat_maps(shifted).axes[0].images[0].get_array())
    power = data["delivered_kw"].values.sum(axis=1)
    assert image.shape == (96, 21)
    assert np.isnan(image[:24, 0]).all() and np.isnan(image[24:, -1]).all()
    assert image[24, 0] == power[0] and image[0, 1] == power[72]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: figures.kpi_radar({"only": kpis(record(1, 8))}), "at least two"),
        (lambda: figures.kpi_bars({"x": {"availability_pct": 99.0}}), "derating_efficiency_pct is missing"),
        (lambda: figures.node_temperatures(record(1, 8)), "no node_temperature_c"),
        (lambda: figures.market_dispatch(record(1, 8)), "not a market study"),
        (lambda: figures.strings(record(1, 8).isel(time=slice(0))), "no time steps"),
        (lambda: figures.string_spread({}), "no result"),
    ],
)
def test_what_cannot_be_drawn_is_said(call: Callable[[], Figure], message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()


def test_a_full_disk_is_one_sentence_without_a_run_to_resume(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    figure = figures.strings(record(2, 96))
    folder = write_run(tmp_path / "run", record(2, 96))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, limits[1]))
    try:
        for write in (lambda: save_figure(figure, tmp_path / "strings.svg"), lambda: write_report(folder)):
            with pytest.raises(bess.BessError, match=r"\.svg: the disk is full, make room; .* try again$"):
                write()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
