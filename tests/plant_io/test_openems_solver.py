"""The contract of OpenEMS' solver over HTTP."""

import numpy as np
import pytest

from bess.edge.plant_io.openems_solver import answer
from bess.errors import InputError


def _by_soc(demand_kw: float, soc: np.ndarray) -> np.ndarray:
    """Discharge by what is in a string, charge by what fits in."""
    weight = soc if demand_kw > 0 else 1.0 - soc
    return demand_kw * weight / weight.sum()


def _ask(power_w: object, **soc: object) -> dict[str, object]:
    return {"SetActivePower": power_w, "powerDistribution": {name: {"soc": s} for name, s in soc.items()}}


def test_shares_of_all_batteries_sum_to_a_hundred() -> None:
    said = answer(_ask(50_000, ess0=80, ess1=20, ess2=50), 3, _by_soc)["powerDistribution"]
    assert sum(each["pdist"] for each in said.values()) == pytest.approx(100.0)


def test_a_direction_that_is_not_said_is_the_mean_of_both() -> None:
    said = answer(_ask(50_000, ess0=80, ess1=20), 2, _by_soc)["powerDistribution"]
    assert said["ess0"]["pdist"] == pytest.approx(50.0)
    even = answer(_ask(50_000, ess0=50, ess1=50), 2, lambda kw, soc: np.array([kw, 0.0]))["powerDistribution"]
    assert (even["ess0"]["pdist"], even["ess1"]["pdist"]) == (100.0, 0.0)


def test_what_cannot_be_given_is_not_shared_out() -> None:
    said = answer(_ask(300_000, ess0=50, ess1=50), 2, lambda kw, soc: np.clip([kw / 2] * 2, -92, 92))
    assert [each["pdist"] for each in said["powerDistribution"].values()] == pytest.approx([92 / 3, 92 / 3])


def test_batteries_are_strings_in_the_order_of_their_numbers() -> None:
    seen = []

    def split(demand_kw: float, soc: np.ndarray) -> np.ndarray:
        seen.append(soc.tolist())
        return np.array([demand_kw, 0.0, 0.0])

    said = answer(_ask(1000, ess10=30, ess9=20, ess1=10), 3, split)["powerDistribution"]
    assert seen[0] == pytest.approx([0.1, 0.2, 0.3])
    assert said["ess1"]["pdist"] == 100.0


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (None, "SetActivePower"),
        ([], "SetActivePower"),
        (_ask(0, ess0=50, ess1=50), "above 0 W"),
        (_ask(-5, ess0=50, ess1=50), "above 0 W"),
        (_ask("5", ess0=50, ess1=50), "above 0 W"),
        (_ask(True, ess0=50, ess1=50), "above 0 W"),
        (_ask(float("nan"), ess0=50, ess1=50), "above 0 W"),
        (_ask(10**400, ess0=50, ess1=50), "above 0 W"),
        (_ask(1000, ess0=50), "1 batteries, expected 2"),
        ({"SetActivePower": 1000}, "no batteries, expected 2"),
        (_ask(1000, ess0=50, ess1=101), "ess1.soc: 101, expected 0 to 100 %"),
        (_ask(1000, ess0=50, ess1=None), "ess1.soc: None"),
        ({"SetActivePower": 1, "powerDistribution": {"ess0": 5, "ess1": {"soc": 5}}}, "ess0.soc: None"),
    ],
)
def test_another_request_is_refused_in_one_sentence(body: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        answer(body, 2, _by_soc)
