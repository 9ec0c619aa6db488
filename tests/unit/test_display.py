"""Claims about what things say of themselves at a prompt and in a notebook, and about result.plot."""

from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes

import bess
from bess.display import amount, few, rounded


def test_two_digits_have_no_exponent() -> None:
    """A gap without a bound read "1e+02 %", and a long run "2.4e+02 CPU s"."""
    texts = [rounded(value) for value in (100.0, 243.0, 2.41, 0.0123, 0.0, float("nan"))]
    assert texts == ["100", "240", "2.4", "0.012", "0", "nan"]
    assert few([1984.0, 12.34], "kW") == "1980, 12.3 kW"


def test_amounts_of_small_plants_have_a_decimal() -> None:
    """The first screen of a plant of 10 kW read "6 kWh: 0 undelivered + 4 inverters + 2 cells"."""
    texts = [amount(value) for value in (0.0, -0.01, 3.84, -2.06, 99.96, 1752.3)]
    assert texts == ["0", "0", "3.8", "-2.1", "100", "1,752"]


@pytest.fixture(scope="module")
def things() -> dict[str, tuple[Any, list[str]]]:
    """One of each, and what it has to say."""
    system = bess.System.reference(2)
    state = bess.State(soc=[0.5, 0.25], temperature_c=[25.0, 31.5])
    plant = bess.Plant(system, state)
    splitter = bess.PowerSplit(system, horizon_steps=4)
    study = bess.load_study("case1", {"run.days": 0.5, "policy.name": "soc"})
    return {
        "system": (system, ["reference", "184 kW", "536 kWh"]),
        "state": (state, ["0.5, 0.25", "25, 31.5 °C"]),
        "aged": (bess.State([0.5], [25.0], [0.8], [1.3]), ["capacity left: 0.8"]),
        "plant": (plant, ["reference", "soc: 0.5, 0.25", "10 s"]),
        "flows": (bess.Plant(system, state).step([46.0, 0.0]), ["delivered: 46, 0 kW"]),
        "record": (bess.Plant(system, state).run([[46.0, 0.0]] * 3), ["steps: 3", "strings: 2"]),
        "splitter": (splitter, ["4 steps of 15 min"]),
        "split": (splitter(state, [60.0] * 4), ["set-points now:", "kW", "status:", "gap:"]),
        "rollout": (
            bess.rollout(system, state, np.full((2, 4), 40.0)),
            ["steps: 4", "strings: 2", "soc at the"],
        ),
        "batch": (bess.rollout(system, state, np.full((3, 2, 4), 40.0)), ["schedules: 3", "steps: 4"]),
        "plan": (
            bess.plan_dispatch(system, [20.0] * 8 + [90.0] * 8, state, hours=4),
            ["steps: 16", "kW", "expected net:", "EUR"],
        ),
        "study": (study, ["case1", "policy: soc", "days: 0.5"]),
        "result": (bess.run(study, progress=False), ["48 of 15 min", "strings: 2", "lost:"]),
    }


NAMES = [
    *("system", "state", "aged", "plant", "flows", "record", "splitter", "split", "rollout", "batch", "plan"),
    *("study", "result"),
]


class Text(HTMLParser):
    text = ""

    def handle_data(self, data: str) -> None:
        self.text += data + " "


@pytest.mark.parametrize("name", NAMES)
def test_objects_are_shown_in_one_line(name: str, things: dict[str, tuple[Any, list[str]]]) -> None:
    thing, said = things[name]
    text = repr(thing)
    assert str(thing) == text
    assert "\n" not in text and len(text) < 300 and type(thing).__name__ in text
    for part in said:
        assert part in text


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_shows_the_same_as_a_table(name: str, things: dict[str, tuple[Any, list[str]]]) -> None:
    thing, said = things[name]
    page = Text()
    page.feed(thing._repr_html_())
    for part in said:
        assert part.rpartition(": ")[2].removesuffix(":") in page.text


def test_many_strings_are_shown_by_the_first_and_the_last() -> None:
    state = bess.State([index / 40 for index in range(40)], [25.0] * 40)
    assert "0, 0.025, 0.05, …, 0.95, 0.975" in repr(state)


@pytest.mark.parametrize("name", ["strings", "power", "spread", "durations"])
def test_plots_of_several_panels_return_their_axes(
    name: str, things: dict[str, tuple[Any, list[str]]]
) -> None:
    mpl.use("agg")
    import matplotlib.pyplot as plt

    panels = getattr(things["result"][0].plot, name)()
    assert len(panels) > 1 and all(isinstance(axes, Axes) for axes in panels)
    assert panels[0].figure.number in plt.get_fignums(), "a notebook shows figures of pyplot"
    plt.close("all")


def test_axes_of_a_plot_can_be_changed_and_saved(
    things: dict[str, tuple[Any, list[str]]], tmp_path: Path
) -> None:
    mpl.use("agg")
    import matplotlib.pyplot as plt

    plot = things["result"][0].plot
    for axes in (plot.losses(), plot.temperature(), plot.inverters(), plot()[0]):
        axes.set_title("mine")
        axes.figure.savefig(tmp_path / "mine.png")
        assert (tmp_path / "mine.png").stat().st_size > 1000
    plt.close("all")
    assert not plt.get_fignums()
