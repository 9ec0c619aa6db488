"""Result folders as ``bess run`` leaves them, filled with synthetic records."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from synthetic import kpis

import bess
from bess.simulation.record.dataset import write_netcdf
from bess.simulation.record.store import write_part


def write_run(
    directory: Path,
    dataset: xr.Dataset,
    name: str = "demo",
    *,
    policy: dict[str, Any] | None = None,
    done: int | None = None,
) -> Path:
    """Write a finished run, or one that was stopped after ``done`` steps."""
    directory.mkdir(parents=True)
    steps, n_strings = dataset.sizes["time"], dataset.sizes["string"]
    study = {
        "name": name,
        "title": f"Study of {name}",
        "policy": {"name": "mpc", "gap": 1e-3, **(policy or {})},
    }
    initial = {key: value.tolist() for key, value in dataset.attrs.items()}
    times_s = dataset["time"].values[:2].astype("datetime64[s]").astype(int)
    step_s = int(np.diff(times_s)[0])
    frame = {
        "start_s": int(times_s[0]),
        "step_s": step_s, "n_steps": steps,
        "attrs": {"title": study["title"], "step_h": step_s / 3600.0, "time_zone": "UTC", **initial},
        "statuses": {"0": "none", "1": "optimal"}, "limit_flags": {"1": "soc_max"},
    }  # fmt: skip
    system = bess.System.reference(n_strings).document
    identity = {"version": "0.0.test", "study": study, "system": system, "files": {}, "frame": frame}
    (directory / "run.json").write_text(json.dumps(identity))
    (directory / "study.toml").write_text(f'name = "{name}"\n\n[policy]\nname = "mpc" # <&>\n')
    arrays = {str(key): dataset[key].values for key in dataset.data_vars}
    if done is None:
        write_netcdf(directory / "results.nc", identity["frame"], iter([(0, arrays)]))
        (directory / "kpis.json").write_text(json.dumps(kpis(dataset)))
    else:
        write_part(directory, 0, {key: values[:done] for key, values in arrays.items()}, {"step": done})
    times = np.random.default_rng(1).lognormal(-4, 0.6, steps)
    lines = [
        json.dumps({"step": i, "solve_time_s": None if i % 5 == 0 else float(t)}) for i, t in enumerate(times)
    ]
    (directory / "log.jsonl").write_text("\n".join(lines) + "\n")
    return directory
