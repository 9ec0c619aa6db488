"""Claims about study files: defaults, overrides, scenarios, sweeps, and errors that say what to do."""

import re
import tomllib
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import bess
from bess.control.policies import POLICIES
from bess.simulation.inputs import prepare
from bess.study import bundled_studies, expand
from bess.study.demands import DEMAND_KINDS
from bess.study.demands.source import StepInputs
from bess.study.keys import parse_assignment
from bess.study.scenarios import refined
from bess.study.study import Study

MINIMAL = '[demand]\nfile = "two-cycle-48h"\n'


def written(folder: Path, text: str, name: str = "study.toml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", bundled_studies())
def test_every_bundled_study_loads_expands_and_survives_a_round_trip(name: str, tmp_path: Path) -> None:
    study = bess.load_study(name)
    for run in expand(study).values():
        assert run.policy.name in POLICIES
    assert bess.load_study(written(tmp_path, study.to_toml())) == study


def test_case_studies_need_no_data_files() -> None:
    for name in ("case1", "case2"):
        for run in expand(bess.load_study(name)).values():
            inputs = prepare(run)
            assert inputs.files == []
            assert inputs.grid.n_steps == 192


def test_case2_has_the_weights_of_the_paper() -> None:
    weights = {
        name: (run.policy.objectives.inverter.weight, run.policy.objectives.battery.weight)
        for name, run in expand(bess.load_study("case2")).items()
    }
    assert weights == {"S1": (1.0, 0.0), "S2": (0.5, 0.5), "S3": (0.0, 1.0)}


def test_a_study_file_is_named_after_itself_and_its_paths_are_relative_to_it(tmp_path: Path) -> None:
    study = bess.load_study(written(tmp_path, '[demand]\nfile = "load.csv"\n', "plant-a.toml"))
    assert study.name == "plant-a"
    assert study.demand.file == str(tmp_path / "load.csv")  # type: ignore[union-attr]


@pytest.mark.parametrize("kind", DEMAND_KINDS)
def test_a_kind_of_demand_has_the_name_of_the_registry_and_lists_keys_that_it_has(kind: str) -> None:
    section = DEMAND_KINDS[kind]
    assert section.model_fields["kind"].default == kind
    assert section.files and {file.partition(".")[0] for file in section.files} <= set(section.model_fields)


def test_paths_on_the_command_line_are_relative_to_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    study = bess.load_study("arbitrage-2024", {"demand.prices": "prices.csv"})
    assert study.demand.prices == str(tmp_path / "prices.csv")  # type: ignore[union-attr]


@pytest.mark.parametrize("market", ["demand.market.0", "demand.market[0]"])
def test_files_of_scenarios_and_axes_are_relative_to_the_study_file(market: str, tmp_path: Path) -> None:
    text = f"""
    [demand]
    prices = "prices.csv"
    [[demand.market]]
    name = "auction"
    [[scenario]]
    name = "a"
    set = {{ "system.file" = "plant.toml", "{market}.prices" = "a.csv", title = "b.csv" }}
    [[sweep]]
    key = "weather.file"
    values = ["mild.csv", "hot/july.csv"]
    """
    study = bess.load_study(written(tmp_path, text))
    settings, files = study.scenario[0].set, study.sweep[0].values
    assert settings["system.file"] == str(tmp_path / "plant.toml")
    assert settings["demand.market.0.prices"] == str(tmp_path / "a.csv")
    assert settings["title"] == "b.csv"
    assert files == (str(tmp_path / "mild.csv"), str(tmp_path / "hot/july.csv"))
    # Names of runs, and thereby of their folders, do not depend on the folder of the study.
    assert list(expand(study)) == ["a_file=mild.csv", "a_file=hot-july.csv"]


def test_a_key_of_a_table_in_a_list_is_set_by_its_index() -> None:
    event = {"string": 0, "start": datetime(2024, 1, 1, tzinfo=UTC), "end": datetime(2024, 1, 2, tzinfo=UTC)}
    study = bess.load_study("case1", {"event": [event]}).with_values({"event.0.limit_kw": 30.0})
    assert study.event[0].limit_kw == 30.0
    assert study.with_values({"event[0].limit_kw": 20.0}).event[0].limit_kw == 20.0
    with pytest.raises(bess.InputError, match="'1' is no index of a list of 1 entries"):
        study.with_values({"event.1.limit_kw": 30.0})


def test_a_key_may_write_an_index_in_brackets_in_a_search_too() -> None:
    event = {"string": 0, "start": datetime(2024, 1, 1, tzinfo=UTC), "end": datetime(2024, 1, 2, tzinfo=UTC)}
    axis = {"key": "event[0].limit_kw", "values": [10.0, 30.0], "maximise": "net_eur", "refine": 1}
    study = bess.load_study("case1", {"event": [event], "sweep": [axis]})
    runs = expand(study)
    kpis = {name: {"net_eur": run.event[0].limit_kw} for name, run in runs.items()}
    assert [run.event[0].limit_kw for run in refined(study, runs, kpis).values()] == [20.0]


def test_the_kind_of_objectives_follows_the_study_unless_it_is_given() -> None:
    def kind(*changes: dict[str, object], **policy: object) -> str:
        document = {"name": "x", "demand": {"prices": "prices.csv"}, "policy": policy}
        study = Study.from_document(document, "x")
        for change in changes:
            study = study.with_values(change)
        return study.policy.objectives.kind

    assert kind() == kind({"run.days": 1}) == "money"
    assert kind(mode="certified") == kind({"policy.mode": "certified"}) == "energy"
    assert kind({"policy.horizon_steps": 8}, {"policy.gap": 0.01}) == "energy"
    with pytest.raises(bess.InputError, match=r'a certified split needs objectives\.kind = "energy"'):
        kind({"policy.horizon_steps": 8}, objectives={"kind": "money"})


def test_a_change_leaves_the_original_as_it_is() -> None:
    study = bess.load_study("case1")
    changed = study.with_values({"policy.horizon_steps": 4, "system.parameters.battery.r_scale": 1.5})
    assert study.policy.horizon_steps is None
    assert changed.policy.horizon_steps == 4
    assert prepare(changed).system.strings[0].battery.r_scale == 1.5


def test_initial_values_are_one_for_all_strings_or_one_for_each() -> None:
    values = {
        "system.n_strings": 3,
        "system.initial_soc": [0.2, 0.5, 0.8],
        "system.initial_temperature_c": 30,
    }
    state = prepare(bess.load_study("case1", values)).system.initial_state()
    np.testing.assert_array_equal(state.soc, [0.2, 0.5, 0.8])
    np.testing.assert_array_equal(state.temperature_c, [30.0, 30.0, 30.0])


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (
            {"policy.horizn_steps": 4},
            "policy.horizn_steps: unknown key; did you mean 'policy.horizon_steps'?",
        ),
        ({"run.dayz": 4}, "did you mean 'run.days'?"),
        ({"policy.objectives.invertr": 1}, "did you mean 'policy.objectives.inverter'?"),
        ({"run.days": -1.0}, "run.days = -1.0: must be in (0, 36525] days"),
        ({"run.days": float("nan")}, "run.days = nan"),
        ({"run.days": 0.3}, "whole number of steps of 15 min"),
        (
            {"run.days": 3, "demand.repeat": False},
            "the run needs 2024-01-01 00:00 to 2024-01-04 00:00 UTC; set run.start and run.days",
        ),
        ({"run.start": "2024-01-01T00:00:00"}, "has no time zone; write for example"),
        ({"run.start": 2024}, "run.start = 2024: is no time; write for example 2024-01-01T00:00:00Z"),
        ({"run.start": "2024"}, "run.start = '2024': is no time"),
        ({"demand.repeat": "maybe"}, "demand.repeat = 'maybe': must be true or false"),
        ({"system.parameters": 3}, "system.parameters = 3: must be a table"),
        ({"run.plant_step_s": 7.0}, "does not divide the control step"),
        ({"run.derating_law": "pid"}, "run.derating_law"),
        ({"policy.name": "mpcc"}, "allowed: equal, priority"),
        ({"policy.gap": 0.0}, "policy.gap"),
        ({"policy.horizon_steps": 0}, "policy.horizon_steps"),
        ({"system.initial_soc": [0.5, 0.5, 0.5]}, "system.initial_soc: 3 values for 2 strings"),
        ({"system.initial_soc": 1.2}, "system.initial_soc"),
        ({"system.initial_soc": [0.5, 2.0]}, "case1: system.initial_soc[1] = 2.0: must be in [0, 1]"),
        ({"system.parameters.battery.r_scale": -1.0}, "system.parameters: reference: battery.r_scale = -1"),
        ({"system.file": "referenz"}, "referenz"),
        ({"demand.scale": "two"}, "demand.scale"),
        ({"demand.kind": "arbitrag"}, "kind = 'arbitrag' is unknown; allowed: 'profile', 'arbitrage'"),
        ({"demand": 3}, "demand = 3: must be a table"),
        (
            {"event": [{"string": 2, "start": "2024-01-01T00:00Z", "end": "2024-01-01T01:00Z"}]},
            "strings 0 to 1",
        ),
        (
            {"event": [{"string": 0, "start": "2024-01-01T02:00Z", "end": "2024-01-01T01:00Z"}]},
            "not after start",
        ),
        (
            {"event": [{"string": 0, "start": "2025-01-01T00:00Z", "end": "2025-01-02T01:00Z"}]},
            "outside the run",
        ),
    ],
)
def test_bad_values_are_refused_with_key_value_and_what_is_allowed(
    values: dict[str, Any], expected: str
) -> None:
    from bess.control.policies import build_policy
    from bess.study.plant_choice import policy_settings

    with pytest.raises(bess.InputError) as caught:
        study = bess.load_study("case1", values)
        inputs = prepare(study)
        build_policy(study.policy.name, inputs.system, policy_settings(study, inputs.system))
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("twice", ["two axes", "an axis and a scenario"])
def test_a_key_that_is_set_twice_is_refused(twice: str) -> None:
    """Otherwise the last value would win, in runs that are named after both."""
    axis = {"key": "demand.scale", "values": [1.0, 2.0]}
    scenario = {"name": "a", "set": {"demand.scale": 0.5}}
    tables = {"sweep": [axis, axis]} if twice == "two axes" else {"sweep": [axis], "scenario": [scenario]}
    with pytest.raises(bess.InputError, match=r"demand\.scale is set by several axes"):
        expand(bess.load_study("case1", tables))


def test_numbers_of_numpy_are_numbers() -> None:
    study = bess.load_study("case1", {"system.n_strings": np.int64(3), "demand.scale": np.float32(0.5)})
    assert (study.system.n_strings, study.demand.scale) == (3, 0.5)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[demand]\nfle = 'x'\n", "demand.fle: unknown key; did you mean 'demand.file'?"),
        (
            "[demand]\nfile = 'x'\n[zz]\nqq = 1\n",
            "zz: unknown key; allowed: augmentation, budget, contract, demand",
        ),
        ("[demand]\nfile = 'x'\n[run]\nstart = 2024-01-01\n", "run.start = 2024-01-01: has no time zone"),
        (MINIMAL + "prices = 'x'\n", "demand.file: unknown key; it is a key of kind 'profile'"),
        ("[demand]\nkind = 'fcr'\nxyz = 1\n", "demand.xyz: unknown key; allowed: band, capacity_kw, "),
        ("[demnd]\nfile = 'x'\n", "demnd: unknown key; did you mean 'demand'?"),
        ("", "demand: missing"),
        ("[demand\n", "not valid TOML"),
        (MINIMAL + "[[scenario]]\nname = 'a/b'\nset = {}\n", "scenario[0].name = 'a/b'"),
        (MINIMAL + "[[sweep]]\nkey = 'policy.gap'\n", "an axis is key + values"),
        (
            MINIMAL + "[[sweep]]\nkey = 'policy.gap'\nvalues = []\n",
            "sweep[0].values: must be a list of at least 1, not of 0",
        ),
        (
            MINIMAL + "[[scenario]]\nname = 'a'\nset = { name = 'b' }\n",
            "scenario[0]: set.name: a scenario is one run, with the name that its table gives",
        ),
    ],
)
def test_bad_files_are_refused_with_their_name(text: str, expected: str, tmp_path: Path) -> None:
    path = written(tmp_path, text)
    with pytest.raises(bess.InputError) as caught:
        bess.load_study(path)
    assert str(path) in str(caught.value)
    assert expected in str(caught.value)


def test_a_missing_study_names_the_nearest_bundled_one() -> None:
    with pytest.raises(bess.InputError, match="did you mean 'case1'"):
        bess.load_study("case11")


def test_scenarios_are_combined_with_every_point_of_every_axis(tmp_path: Path) -> None:
    text = MINIMAL + (
        '[[scenario]]\nname = "cold"\nset = { "system.ambient_c" = 5.0 }\n'
        '[[scenario]]\nname = "hot"\nset = { "system.ambient_c" = 35.0 }\n'
        '[[sweep]]\nkey = "policy.horizon_steps"\nvalues = [4, 8]\n'
        '[[sweep]]\nkey = "demand.scale"\nstart = 0.5\nstop = 1.5\ncount = 3\n'
    )
    runs = expand(bess.load_study(written(tmp_path, text)))
    assert len(runs) == 2 * 2 * 3
    run = runs["hot_horizon_steps=8_scale=1.5"]
    assert (run.name, run.system.ambient_c) == ("hot_horizon_steps=8_scale=1.5", 35.0)
    assert run.policy.horizon_steps == 8
    assert run.demand.scale == 1.5  # type: ignore[union-attr]
    assert not run.scenario and not run.sweep


def test_a_simplex_has_all_shares_that_sum_to_one(tmp_path: Path) -> None:
    keys = ", ".join(f'"policy.objectives.{name}"' for name in ("derating", "inverter", "battery"))
    text = MINIMAL + f"[[sweep]]\nsimplex = [{keys}]\ndivisions = 4\n"
    goals = [run.policy.objectives for run in expand(bess.load_study(written(tmp_path, text))).values()]
    points = {tuple(objective.weight for objective in goal.members[1:]) for goal in goals}
    assert len(points) == len(goals) == 15  # (4 + 2 over 2)
    assert all(sum(point) == 1.0 for point in points)


def test_a_wrong_key_in_a_sweep_is_refused_before_anything_runs(tmp_path: Path) -> None:
    text = MINIMAL + '[[sweep]]\nkey = "policy.horizonsteps"\nvalues = [4, 8]\n'
    with pytest.raises(bess.InputError, match=r"did you mean 'policy\.horizon_steps'"):
        expand(bess.load_study(written(tmp_path, text)))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a.b=3", ("a.b", 3)),
        ("a.b = 3.5", ("a.b", 3.5)),
        ("a=[0.4, 0.6]", ("a", [0.4, 0.6])),
        ("a=true", ("a", True)),
        ("a=some/file.csv", ("a", "some/file.csv")),
        ('a="quoted"', ("a", "quoted")),
        ("a=b=c", ("a", "b=c")),
    ],
)
def test_an_assignment_is_a_key_and_a_toml_value(text: str, expected: tuple[str, object]) -> None:
    assert parse_assignment(text) == expected


@pytest.mark.parametrize("text", ["a", "=3", "a=", "a=[1, 2"])
def test_a_broken_assignment_is_refused(text: str) -> None:
    with pytest.raises(bess.InputError, match="--set"):
        parse_assignment(text)


def test_a_profile_that_repeats_starts_again_at_its_end() -> None:
    inputs = prepare(bess.load_study("case1", {"run.days": 5, "demand.repeat": True}))
    now = StepInputs(inputs.system.initial_state(), inputs.limit_kw[0], inputs.ambient_c)
    values = np.array([inputs.demand.ahead(step, 1, now)[0] for step in range(inputs.grid.n_steps)])
    np.testing.assert_array_equal(values[192:384], values[:192])
    assert values.max() == 78.0 and values.min() == -78.0


@pytest.mark.parametrize("first", [-6, 96, 160, 1000])
def test_a_run_that_starts_within_a_repeated_profile_takes_it_up_there(first: int, tmp_path: Path) -> None:
    """Shorter than the profile, and before, within and after its time stamps."""
    times = pd.date_range("2024-01-01", periods=192, freq="15min", tz="UTC", name="time")
    path = tmp_path / "profile.csv"
    pd.DataFrame({"power": np.arange(192.0) / 4.0}, index=times).to_csv(path)
    start = (times[0] + first * times.freq).to_pydatetime()
    values = {"demand.file": str(path), "demand.repeat": True, "run.start": start, "run.days": 0.5}
    inputs = prepare(bess.load_study("case1", values))
    now = StepInputs(inputs.system.initial_state(), inputs.limit_kw[0], inputs.ambient_c)
    demand_kw = [inputs.demand.ahead(step, 1, now)[0] for step in range(48)]
    np.testing.assert_array_equal(demand_kw, (first + np.arange(48)) % 192 / 4.0)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("case1", {"demand.repeat": True}),
        ("case1", {"run.days": 1}),  # of a profile of two days
        ("peak-shaving", {"demand.repeat": True}),
        ("self-consumption", {"run.days": 1}),
        ("fcr", {}),
    ],
)
def test_a_run_ends_what_is_foreseen(name: str, values: dict[str, Any]) -> None:
    inputs = prepare(bess.load_study(name, values))
    now = StepInputs(inputs.system.initial_state(), inputs.limit_kw[0], inputs.ambient_c)
    last = inputs.grid.n_steps - 1
    assert not inputs.demand.ahead(last, 8, now)[1:].any()


def test_prices_beside_a_reserve_do_not_repeat_and_no_remedy_says_so(tmp_path: Path) -> None:
    times = pd.date_range("2024-01-01", periods=24, freq="h", tz="UTC", name="time")
    pd.DataFrame({"price": np.arange(24.0)}, index=times).to_csv(tmp_path / "prices.csv")
    values = {"demand.prices": str(tmp_path / "prices.csv"), "run.start": times[0], "run.days": 2}
    with pytest.raises(bess.InputError, match=r"prices\.csv covers .*; set run\.start and run\.days$"):
        prepare(bess.load_study("fcr-arbitrage", values))


@pytest.mark.parametrize(
    ("day", "remedy"), [(2, "run.days, or demand.meter.repeat = true"), (-1, "run.days")]
)
def test_a_load_that_does_not_cover_the_run_is_refused_with_the_key_that_helps(
    day: int, remedy: str, tmp_path: Path
) -> None:
    times = pd.date_range("2024-01-01", periods=24 * 5, freq="h", tz="UTC", name="time")
    pd.DataFrame({"price": np.arange(times.size)}, index=times).to_csv(tmp_path / "prices.csv")
    load = times[24 * 2 :] - pd.Timedelta(days=day)
    pd.DataFrame({"load": np.ones(load.size)}, index=load).to_csv(tmp_path / "load.csv")
    values = {
        "demand.prices": str(tmp_path / "prices.csv"),
        "demand.plan": "linear",
        "demand.meter.load": str(tmp_path / "load.csv"),
        "run.start": times[48].to_pydatetime(),
        "run.days": 3,
    }
    study = bess.load_study("arbitrage-2024", values)
    with pytest.raises(
        bess.InputError, match=rf"load\.csv covers .*; set run\.start and {re.escape(remedy)}$"
    ):
        prepare(study)


def test_the_resolved_study_names_every_default() -> None:
    document = tomllib.loads(bess.load_study("case1").to_toml())
    assert document["policy"]["gap"] == 1e-3
    assert document["demand"]["kind"] == "profile"
    assert document["run"]["derating_law"] == "table"


def test_a_run_ends_with_where_its_time_went(capfd: pytest.CaptureFixture[str]) -> None:
    bess.run(bess.load_study("case1", {"policy.name": "soc"}))
    line = capfd.readouterr().err.splitlines()[-1]
    total, *parts = (float(number) for number in re.findall(r"([0-9.]+) s\b", line))
    assert re.sub(r"[0-9.]+ s", "_", line) == (
        "case1: _, of which policy _, plant _, files _, demand and closed loop _"
    )
    assert sum(parts) == pytest.approx(total, abs=0.3)


@pytest.mark.parametrize("days", [(2, 3), (3, 2)])
def test_a_string_serves_from_the_first_of_its_augmentations_on(days: tuple[int, int]) -> None:
    tables = [{"string": 1, "date": datetime(2024, 1, day, tzinfo=UTC)} for day in days]
    values = {"run.start": datetime(2024, 1, 1, tzinfo=UTC), "run.days": 4, "augmentation": tables}
    installations = prepare(bess.load_study("case1", values)).installations
    assert [bool(installations.in_service(step)[1]) for step in (95, 96, 192)] == [False, True, True]


def test_a_study_of_invalid_arguments_is_refused_in_a_sentence() -> None:
    with pytest.raises(bess.InputError, match=r"^Study: name: missing; demand: missing$"):
        bess.Study()
