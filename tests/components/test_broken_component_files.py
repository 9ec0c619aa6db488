"""Property: a broken component file gives a usable table or one InputError that names it, nothing else."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bess
from bess.system.battery import OcvTable, ResistanceTable
from bess.system.components import read_inverter, read_ocv, read_resistance
from bess.system.sections import Inverter

PLAIN = "Power;Charging;Discharging\n0;0;0\n0,2;90;91\n0,5;95;96\n1,0;96;97\n"
SANDIA = (
    ",Paco,Pdco,Vdco,Pso,C0,C1,C2,C3,Pnt\nA,100,105,480,1.2,-3e-7,-6e-5,-6e-4,-9e-4,0.03\n"
    "B,50,55,480,1,0,0,0,0,0\n"
)
BSLIB = (
    "ID,P_AC2BAT_in [W],P_BAT2AC_out [W],AC2BAT_a_in,AC2BAT_b_in,AC2BAT_c_in,"
    "BAT2AC_a_out,BAT2AC_b_out,BAT2AC_c_out\nS1,1000,900,35,3,18,37,3,19\n"
)
OCV = "SOC (T=298.15K),OCV (T=298.15K)\n0,3.2\n50,3.7\n100,4.1\n"
RESISTANCE = 'SOC,"R_Ch(T=298.15 K, 0.5 C)","R_DCh(T=298.15 K, 0.5 C)"\n0,1.5,1.6\n0.5,1.1,1.2\n1,1.0,1.1\n'


def _cuts(text: str) -> st.SearchStrategy[bytes]:
    """Truncate, replace a stretch by other characters, or swap the separator."""
    piece = st.text(alphabet='0123456789.,;-eE\n\tnaNxµ"\x00', max_size=6)
    spot = st.integers(0, len(text))
    return st.one_of(
        st.tuples(spot, spot, piece).map(
            lambda cut: (text[: min(cut[:2])] + cut[2] + text[max(cut[:2]) :]).encode()
        ),
        st.tuples(spot, piece).map(lambda put: (text[: put[0]] + put[1] + text[put[0] :]).encode()),
        spot.map(lambda end: text[:end].encode()),
        st.sampled_from([text.replace(",", "\t").encode(), text.encode("utf-16"), text.encode() * 2]),
        st.binary(max_size=80),
    )


def _inverter(path: Path) -> Any:
    return Inverter.model_validate(read_inverter(path, model="A", nominal_kw=1.0).section())


def _plain(path: Path) -> Any:
    return Inverter.model_validate(read_inverter(path, nominal_kw=1.0).section())


def _ocv(path: Path) -> Any:
    return OcvTable.model_validate(read_ocv(path))


def _resistance(path: Path) -> Any:
    return ResistanceTable.model_validate(read_resistance(path, control_c_rate=0.5))


READERS = [
    pytest.param(_plain, PLAIN, id="plain"),
    pytest.param(_inverter, SANDIA, id="sandia"),
    pytest.param(_plain, BSLIB, id="bslib"),
    pytest.param(_ocv, OCV, id="ocv"),
    pytest.param(_resistance, RESISTANCE, id="resistance"),
]


@pytest.mark.parametrize(("read", "text"), READERS)
def test_the_whole_file_is_read(read: Any, text: str, tmp_path: Path) -> None:
    path = tmp_path / "component.csv"
    path.write_text(text)
    read(path)


@pytest.mark.parametrize(("read", "text"), READERS)
@settings(max_examples=150, deadline=None, derandomize=True)
@given(data=st.data())
def test_a_broken_file_is_a_table_or_one_input_error(
    read: Any, text: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "component.csv"
    path.write_bytes(data.draw(_cuts(text)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            read(path)
        except bess.InputError as error:
            assert "component.csv" in str(error)
            assert "\n" not in str(error)
