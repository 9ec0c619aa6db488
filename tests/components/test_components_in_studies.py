"""What a study says about cells and inverters is what its plant has."""

from pathlib import Path

import pytest

import bess
from bess.study.plant_choice import build_system
from bess.study.sections import RunSection, SystemSection, WearSection
from bess.system.components.registry import CELLS, INVERTERS, cell_tables, inverter_section

QUICK = {"policy.name": "equal", "run.days": 0.25}


def system_with(file: str = "reference", **parameters: object) -> bess.System:
    return build_system(SystemSection(file=file, parameters=parameters), RunSection(), WearSection())


def kpis(**values: object) -> dict[str, float]:
    return bess.run(bess.load_study("case1", QUICK | values), progress=False).kpis


@pytest.mark.parametrize("model", INVERTERS)
@pytest.mark.parametrize("file", ["reference", "unequal-4"])
def test_an_inverter_named_in_a_study_replaces_the_whole_table(file: str, model: str) -> None:
    wanted = inverter_section(model)
    inverter = system_with(file, inverter={"model": model}).strings[0].inverter.model_dump()
    assert {key: inverter[key] for key in wanted} == {
        key: tuple(value) if isinstance(value, list) else value for key, value in wanted.items()
    }
    assert system_with(inverter={"model": model, "nominal_kw": 77.0}).nominal_kw.tolist() == [77.0, 77.0]


@pytest.mark.parametrize("cell", CELLS)
def test_a_cell_named_in_a_study_replaces_the_whole_cell(cell: str) -> None:
    battery = system_with(battery={"cell": cell}).strings[0].battery
    wanted = cell_tables(cell)
    assert battery.cell_capacity_ah == wanted["cell_capacity_ah"]
    assert (battery.resistance_table is None) == ("resistance_table" not in wanted)
    assert list(battery.ocv_v.soc) == list(wanted["ocv_v"]["soc"])
    assert battery.cells_series == bess.System.reference().strings[0].battery.cells_series


def test_every_inverter_and_cell_of_a_study_gives_key_figures_of_its_own() -> None:
    inverters = {
        kpis(**{"system.parameters.inverter.model": m})["inverter_efficiency_pct"] for m in INVERTERS
    }
    cells = {kpis(**{"system.parameters.battery.cell": c})["battery_efficiency_pct"] for c in CELLS}
    assert (len(inverters), len(cells)) == (len(INVERTERS), len(CELLS))
    assert kpis()["inverter_efficiency_pct"] in inverters


def test_a_component_named_in_a_file_is_changed_by_the_study(tmp_path: Path) -> None:
    document = bess.System.reference().document | {"inverter": {"model": "sinamics-s120"}}
    (tmp_path / "plant.toml").write_text(bess.System(document).to_toml())
    system = system_with(str(tmp_path / "plant.toml"), inverter={"off_loss": 0.01})
    assert system.strings[0].inverter.off_loss == 0.01
    assert list(system.strings[0].inverter.load) == inverter_section("sinamics-s120")["load"]


def test_a_parameter_that_reaches_no_string_is_refused() -> None:
    with pytest.raises(
        bess.InputError,
        match=r"battery\.r_scale: every string has its own value; set it in \[\[",
    ):
        system_with("unequal-4", battery={"r_scale": 2.0})
    scales = [{"battery": {"r_scale": scale}} for scale in (1.0, 1.5, 2.0, 3.0)]
    strings = system_with("unequal-4", string=scales).strings
    assert [s.battery.r_scale for s in strings] == [1.0, 1.5, 2.0, 3.0]


def test_an_unknown_component_is_refused_with_those_there_are() -> None:
    for section, key in (("battery", "cell"), ("inverter", "model")):
        with pytest.raises(bess.InputError, match=rf"{section}\.{key} = 'x': no such name; bundled"):
            system_with(**{section: {key: "x"}})
