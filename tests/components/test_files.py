"""Claims about files of measured components; those in ../shared/data are read where they exist."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bess
from bess.system.battery import OcvTable, ResistanceTable
from bess.system.components import read_inverter, read_ocv, read_resistance
from bess.system.sections import Inverter

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
real = pytest.mark.skipif(not DATA.is_dir(), reason=f"measured data are not at {DATA}")


@real
def test_sinamics_loses_what_was_measured_within_the_stated_error() -> None:
    table = read_inverter(DATA / "inverter/simses_sinamics_S120_efficiency.csv", nominal_kw=92.0)
    assert 15 <= table.load.size <= 40
    eta = np.loadtxt(DATA / "inverter/simses_sinamics_S120_efficiency.csv", delimiter=",", skiprows=1)[1:]
    x = np.linspace(0.001, 1.0, 1000)
    for loss, measured in (
        (table.loss_charge, x * (1 - eta[:, 0])),
        (table.loss_discharge, x * (1 / eta[:, 1] - 1)),
    ):
        assert np.abs(np.interp(x, table.load, loss) - measured).max() <= table.max_error + 1e-12
    assert table.max_error <= 5e-5
    assert 1 - table.loss_charge[-1] == pytest.approx(0.97344, abs=1e-5)
    assert 1 / (1 + table.loss_discharge[-1]) == pytest.approx(0.97585, abs=1e-5)
    slopes = np.diff(table.loss_charge) / np.diff(table.load)
    assert (np.diff(slopes) < 0.0).any(), "this table is not convex"


@real
def test_all_cec_inverters_agree_with_the_sampled_sandia_model() -> None:
    import pandas as pd

    parameters = pd.read_csv(DATA / "inverter/pvlib_cec_selected_params.csv", index_col=0)
    samples = pd.read_csv(DATA / "inverter/inverter_cec_sandia_model_selected.csv")
    checked = 0
    for name in parameters.index:
        table = read_inverter(DATA / "inverter/pvlib_cec_selected_params.csv", model=name)
        Inverter.model_validate(table.section())
        rows = samples[(samples.name == name) & (samples.Vdc == parameters.Vdco[name])]
        error = np.interp(rows.p_pu, table.load, table.loss_discharge) - rows.loss_W / rows.Paco_W
        assert np.abs(error).max() <= table.max_error + 1e-9, name
        checked += len(rows)
    assert checked == 7 * len(parameters)


@real
@pytest.mark.parametrize("model", ["SG1", "S2", "S3", "S4", "S5"])
def test_bslib_systems_lose_their_polynomial(model: str) -> None:
    table = read_inverter(DATA / "inverter/bslib_database.csv", model=model)
    Inverter.model_validate(table.section())
    full_load_efficiency = 1.0 / (1.0 + table.loss_discharge[-1])
    assert 0.93 < full_load_efficiency < 0.98


@real
def test_on_board_charger_of_one_direction_serves_for_both() -> None:
    table = read_inverter(DATA / "inverter/obc_efficiency_7kW.csv", nominal_kw=7.0, power_unit="kw")
    np.testing.assert_array_equal(table.loss_charge, table.loss_discharge)
    assert 1.0 / (1.0 + table.loss_discharge[-1]) == pytest.approx(0.97233, abs=1e-4)


@real
def test_files_of_several_inverters_or_without_nominal_power_ask_for_what_is_missing() -> None:
    with pytest.raises(bess.InputError, match="choose one of"):
        read_inverter(DATA / "inverter/bslib_database.csv")
    with pytest.raises(bess.InputError, match="has no battery inverter"):
        read_inverter(DATA / "inverter/bslib_database.csv", model="INV1")
    with pytest.raises(bess.InputError, match="give nominal_kw"):
        read_inverter(DATA / "inverter/simses_sinamics_S120_efficiency.csv")
    with pytest.raises(bess.InputError, match="give power_unit"):
        read_inverter(DATA / "inverter/obc_efficiency_7kW.csv", nominal_kw=7.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has 0 lines"),
        ("a,b,c\n1,2,3\n", "no inverter file of a known shape"),
        ("power;efficiency\n0,5;0,9\n1,0;x\n", "row 2 of column 'efficiency' is 'x'"),
        ("power;efficiency\n0,5;0,9;7\n", "line 2 has 3 cells, the header has 2"),
        ("power;efficiency\n0,5;0,9\n1,0;\n", "row 2: discharge efficiency is nan"),
        ("power;efficiency\n0,5;98\n1,0;103\n", r"row 2: discharge efficiency is 1\.03"),
    ],
)
def test_broken_inverter_files_are_named_with_their_row(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "inverter.csv"
    path.write_text(text)
    with pytest.raises(bess.InputError, match=rf"inverter\.csv: .*{message}"):
        read_inverter(path, nominal_kw=1.0)


def test_a_bad_cell_of_a_list_of_inverters_is_named_with_its_row(tmp_path: Path) -> None:
    path = tmp_path / "list.csv"
    path.write_text(",Paco,Pdco,Vdco,Pso,C0,C1,C2,C3,Pnt\nA,50,55,480,1,0,0,0,0,0\nB,50,x,480,1,0,0,0,0,0\n")
    with pytest.raises(bess.InputError, match=r"list\.csv: row 2 of column 'Pdco' is 'x'"):
        read_inverter(path, model="B")


def test_a_decimal_comma_table_in_percent_is_read(tmp_path: Path) -> None:
    path = tmp_path / "inverter.csv"
    path.write_text("Leistung;Charging;Discharging\n0;0;0\n0,5;97,5;98\n1,0;96,0;96,5\n")
    table = read_inverter(path, nominal_kw=10.0)
    assert table.loss_charge[-1] == pytest.approx(0.04)
    assert table.loss_discharge[-1] == pytest.approx(1 / 0.965 - 1)


@real
def test_samsung_ocv_keeps_temperature_and_hysteresis() -> None:
    cell = DATA / "cell"
    ocv = OcvTable.model_validate(
        read_ocv(
            cell / "simses_NMC_Samsung_LabTest_cell_00_OCV.csv",
            hysteresis=cell / "simses_NMC_Samsung_LabTest_allcells_HystV.csv",
        )
    )
    assert ocv.temperature_c == (5.0, 15.0, 25.0, 35.0)
    assert len(ocv.soc) <= 60
    measured = np.loadtxt(cell / "cell_samsung94Ah_ocv_hyst_25C.csv", delimiter=",", skiprows=1)
    for rows, column in ((ocv.charge, 3), (ocv.discharge, 4)):
        error = np.interp(measured[:, 0], ocv.soc, rows[2]) - measured[:, column]
        assert np.abs(error).max() < 3e-3


@real
def test_samsung_resistance_keeps_all_four_dimensions() -> None:
    import pandas as pd

    table = ResistanceTable.model_validate(
        read_resistance(DATA / "cell/simses_NMC_Samsung_LabTest_cell_00_Ri.csv", control_c_rate=0.35)
    )
    long = pd.read_parquet(DATA / "cell/cell_samsung94Ah_rint_long.parquet")
    blocks = {"Ch": np.array(table.charge_mohm), "DCh": np.array(table.discharge_mohm)}
    for row in long.itertuples():
        index = table.c_rate.index(row.c_rate), table.temperature_c.index(row.T_C), table.soc.index(row.soc)
        assert blocks[row.direction][index] == pytest.approx(row.R_mOhm, abs=1e-6)
    means = {t: np.mean([b[:, i] for b in blocks.values()]) for i, t in enumerate(table.temperature_c)}
    assert means == {5.0: pytest.approx(1.51, abs=0.01), 15.0: pytest.approx(0.96, abs=0.01),
                     25.0: pytest.approx(0.73, abs=0.01), 35.0: pytest.approx(0.60, abs=0.01)}  # fmt: skip


@real
def test_lfp_tables_in_ohm_and_with_untidy_titles_are_read() -> None:
    table = read_resistance(DATA / "cell/simses_CLFP_Sony_US26650_Rint.csv", control_c_rate=0.5)
    assert table["temperature_c"] == [10.0, 25.0, 40.0, 60.0]
    assert table["discharge_mohm"][0][1][5] == pytest.approx(47.828, abs=1e-3)
    ocv = read_ocv(DATA / "cell/simses2_CLFP_Sony_US26650_OCV.csv")
    assert ocv["temperature_c"] == [25.0]
    assert OcvTable.model_validate(ocv).charge[0][-1] == pytest.approx(3.53, abs=0.01)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("SOC,OCV\n0,3.5\n0.5,3.4\n1,4.0\n", "OCV falls with SOC by 100.0 mV"),
        ("SOC,OCV\n0,3.0\n0,3.4\n", "SOC must ascend"),
        ("x,y\n0,3.0\n", "no column OCV"),
        ("SOC,OCV,OCV\n0,3.0,3.1\n1,4.0,4.1\n", "two columns have the title 'OCV'; name them apart"),
        ("SOC,OCV\n0,3.0\n1,abc\n", "row 2 of column 'OCV' is 'abc'"),
    ],
)
def test_broken_ocv_files_are_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "ocv.csv"
    path.write_text(text)
    with pytest.raises(bess.InputError, match=rf"ocv\.csv: {message}"):
        read_ocv(path)
