"""Claims about bess.run with a policy or a system of one's own, and about policies of other packages."""

import sys
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

import bess
from bess.control.policies import POLICIES, Decision, PolicyInput, Settings, registry
from bess.control.policies.rule import RulePolicy

SHORT = {"run.days": 0.5}


def half_each(inputs: PolicyInput) -> np.ndarray:
    return np.full(2, inputs.demand_kw[0] / 2)


class Counted:
    """All on one string, which changes with every step: it has to remember."""

    statuses = {0: "no optimisation"}  # noqa: RUF012

    def __init__(self) -> None:
        self.steps = 0

    def __call__(self, inputs: PolicyInput) -> Decision:
        request = np.zeros(2)
        request[self.steps % 2] = inputs.demand_kw[0]
        self.steps += 1
        return Decision(request)

    def state_dict(self) -> dict:
        return {"steps": self.steps}

    def load_state_dict(self, state_dict: dict) -> None:
        self.steps = state_dict["steps"]


def _counted(**attributes: object) -> Counted:
    return type("Own", (Counted,), attributes)()  # type: ignore[no-any-return]


def test_a_function_is_a_policy_and_the_record_names_it(tmp_path: Path) -> None:
    study = bess.load_study("case1", SHORT)
    own = bess.run(study, policy=half_each, progress=False, out=tmp_path / "own")
    equal = bess.run(study.with_values({"policy.name": "equal"}), progress=False)
    np.testing.assert_array_equal(own.dataset["request_kw"], equal.dataset["request_kw"])
    assert 'name = "half_each"' in (tmp_path / "own" / "study.toml").read_text()


@pytest.mark.parametrize("small_kw", [3.6e-15, 4e-4])
def test_no_policy_asks_an_inverter_for_less_than_its_least_power(small_kw: float) -> None:
    def nearly_all_on_one(inputs: PolicyInput) -> np.ndarray:
        demand_kw = inputs.demand_kw[0]
        small = np.copysign(min(small_kw, abs(demand_kw)), demand_kw)
        return np.array([demand_kw - small, small])

    study = bess.load_study("case1", SHORT)
    data = bess.run(study, policy=nearly_all_on_one, progress=False).dataset
    asked = np.abs(data["request_kw"].values)
    assert asked[:, 0].any() and not asked[:, 1].any()
    assert not data["inverter_loss_kw"].values[:, 1].any()
    np.testing.assert_allclose(asked.sum(axis=1) + data["unmet_kw"], np.abs(data["demand_kw"]), atol=1e-9)


def test_an_object_of_the_protocol_remembers_from_step_to_step() -> None:
    result = bess.run("case1", policy=Counted(), system=bess.System.reference(2), progress=False)
    request = result.dataset["request_kw"].values
    assert not request[::2, 1].any() and not request[1::2, 0].any() and request.any()


def test_a_policy_that_writes_every_answer_into_the_same_array_is_recorded_step_by_step() -> None:
    request = np.zeros(2)

    def half_into_the_same(inputs: PolicyInput) -> np.ndarray:
        request[:] = inputs.demand_kw[0] / 2
        return request

    study = bess.load_study("case1", SHORT)
    same, fresh = (bess.run(study, policy=each, progress=False) for each in (half_into_the_same, half_each))
    np.testing.assert_array_equal(same.dataset["request_kw"], fresh.dataset["request_kw"])


def test_a_policy_cannot_change_what_the_plant_and_the_record_get() -> None:
    def in_fahrenheit(inputs: PolicyInput) -> np.ndarray:
        inputs.ambient_c[:] = 1.8 * inputs.ambient_c + 32.0
        return half_each(inputs)

    with pytest.raises(bess.BessError, match=r"'in_fahrenheit', step 0: ValueError: .*read-only"):
        bess.run(bess.load_study("case1", SHORT), policy=in_fahrenheit, progress=False)


class Skipping(Counted):
    """A policy that skips steps with the answers of a function."""

    def __init__(self, skip: Callable[[np.ndarray, np.ndarray], object]) -> None:
        super().__init__()
        self.skip = skip


def overwrite(array: np.ndarray) -> np.ndarray:
    array[:] = 0.0
    return np.zeros((0, 2))


@pytest.mark.parametrize(
    ("skip", "message"),
    [
        (lambda kw, limit_kw: overwrite(kw), "step 0: ValueError: .*read-only"),
        (lambda kw, limit_kw: overwrite(limit_kw), "step 0: ValueError: .*read-only"),
        (lambda *_: 1 / 0, "step 0: ZeroDivisionError"),
        (lambda *_: None, "step 0: ValueError: NoneType is not a number"),
        (
            lambda demand_kw, limit_kw: [[np.nan, 0.0]],
            r"step 0: the policy requested \[nan, 0\] kW for -78 kW",
        ),
        (
            lambda demand_kw, limit_kw: [[-78.0, 0.0], [-500.0, 422.0]],
            r"step 1: the policy requested \[-500,",
        ),
        (lambda *_: [[-78.0]], r"step 0: .* needs \(n, 2\) for the first n of 12 steps"),
        (lambda *_: [[-39.0, -39.0]] * 13, r"step 0: .* of shape \(13, 2\)"),
    ],
)
def test_a_skip_can_neither_change_its_inputs_nor_answer_with_what_is_no_power_split(
    skip: Callable[[np.ndarray, np.ndarray], object], message: str
) -> None:
    with pytest.raises(bess.BessError, match=rf"policy 'Skipping', {message}"):
        bess.run(bess.load_study("case1", SHORT), policy=Skipping(skip), progress=False)


def test_skipped_steps_may_be_lists_and_none_asks_an_inverter_for_less_than_its_least_power() -> None:
    def nearly_all_on_one(demand_kw: np.ndarray, limit_kw: np.ndarray) -> list[list[float]]:
        return [[kw - np.copysign(min(4e-4, abs(kw)), kw), np.copysign(min(4e-4, abs(kw)), kw)]
                for kw in demand_kw[:, 0]]  # fmt: skip

    data = bess.run(
        bess.load_study("case1", SHORT), policy=Skipping(nearly_all_on_one), progress=False
    ).dataset
    np.testing.assert_allclose(data["request_kw"].values[:, 0], data["demand_kw"], rtol=1e-15)
    assert not data["inverter_loss_kw"].values[:, 1].any()


def test_a_system_takes_the_place_of_that_of_the_study_and_its_initial_values_stay() -> None:
    study = bess.load_study("case1", {**SHORT, "policy.name": "equal", "system.initial_soc": 0.4})
    result = bess.run(study, system=bess.System.reference(3), progress=False)
    assert result.dataset.sizes["string"] == 3
    np.testing.assert_array_equal(result.dataset.attrs["initial_soc"], 0.4)


@pytest.mark.parametrize(
    ("policy", "message"),
    [
        (3.0, "policy: float is not callable"),
        ("equal", "policy = 'equal': set named policies in the study"),
        (
            type("Half", (), {"__call__": lambda _, s: s, "state_dict": dict})(),
            "has state_dict, but no load_state_dict, statuses",
        ),
        (lambda inputs: [1.0, 2.0], r"requested \[1, 2\] kW for -78 kW"),
        (lambda inputs: [[1.0], [2.0]], "step 0"),
        (_counted(statuses=None), "policy Own: statuses must be a table of texts by their code"),
        (_counted(statuses={1: "solved"}), "policy 'Own', step 0: status 0 is none of {1: 'solved'}"),
    ],
)
def test_what_is_no_policy_is_refused_in_a_sentence(policy: object, message: str) -> None:
    with pytest.raises(bess.BessError, match=message):
        bess.run(bess.load_study("case1", SHORT), policy=policy, progress=False)


@pytest.fixture
def plug_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A package beside this one, as pip would install it."""
    (tmp_path / "three_to_one.py").write_text(
        "import numpy as np\n"
        "from bess.control.policies.rule import RulePolicy, water_fill\n"
        "def build(system, settings):\n"
        "    weights = np.array([3.0, 1.0])\n"
        "    share = lambda system, asked: water_fill(asked.demand_kw, weights, asked.capability_kw)\n"
        "    return RulePolicy(system, settings.dt_h, share)\n"
    )
    information = tmp_path / "three_to_one-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: three-to-one\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(
        "[bess.policies]\nuneven = three_to_one:build\nbroken = three_to_one:nothing\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    yield "uneven"
    sys.modules.pop("three_to_one", None)


def test_a_policy_of_another_package_is_found_by_its_entry_point(plug_in: str) -> None:
    assert registry.plug_ins()[plug_in] == EntryPoint(plug_in, "three_to_one:build", "bess.policies")
    policy = bess.control.policies.build_policy(plug_in, bess.System.reference(2), Settings())
    assert isinstance(policy, RulePolicy)
    from bess.cli.studies import listing

    assert "plug-in three_to_one:build" in listing()
    result = bess.run(bess.load_study("case1", {**SHORT, "policy.name": plug_in}), progress=False)
    # Two hours in which neither string is near an end.
    np.testing.assert_allclose(result.dataset.request_kw.values[:8], [[-58.5, -19.5]] * 8)


def test_a_plug_in_that_cannot_be_loaded_is_said(plug_in: str) -> None:
    with pytest.raises(bess.InputError, match="plug-in three_to_one:nothing fails: AttributeError"):
        bess.control.policies.build_policy("broken", bess.System.reference(2), Settings())
    with pytest.raises(
        bess.InputError, match=f"no such policy; allowed: {', '.join(POLICIES)}, broken, uneven"
    ):
        bess.control.policies.build_policy("coldest", bess.System.reference(2), Settings())
