"""Mutations of the bounds: each breaks one line of bound or pruning code, and some test has to notice.

    python tests/split/mutations.py [python|rust]

Works on a copy of the checkout. A mutation of Python is tried on the tests of the tree, the nodes and the bounds, one
of Rust on the tests of ``bess-control``; what survives is printed, and the exit status is their number.
"""

# ruff: noqa: E501

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
TREE, BOUNDS = (f"python/bess/control/split/{name}.py" for name in ("tree", "bounds"))
CONIC, DATA, GROUP = (
    f"python/bess/control/split/relaxation/{name}.py" for name in ("conic", "data", "group")
)
ENVELOPE = "python/bess/convexity.py"
REACH = "rust/bess-control/src/reach"
ONE_STEP = "rust/bess-control/src/one_step"
PROOF = "rust/bess-control/src/plan/proof"

# fmt: off
PYTHON = [
    (
        "failed leaves are dropped",
        TREE,
        "            closed = min(closed, bound)\n",
        "            closed = min(closed, bound) if solved.bound > -np.inf else closed\n",
    ),
    ("leaves are dropped", TREE, "            closed = min(closed, bound)\n", "            pass\n"),
    ("an integral node keeps no bound", TREE, "closed = min(closed, bound)", "closed = max(closed, bound)"),
    ("a node forgets its parent's bound", TREE, "max(solved.bound, inherited)", "solved.bound"),
    ("the relative gap is ten times wider", TREE, "gap * abs(best)", "10.0 * gap * abs(best)"),
    (
        "the worst open node is the bound",
        TREE,
        "min(closed, heap[0][0] if heap else np.inf)",
        "min(closed, max(h[0] for h in heap) if heap else np.inf)",
    ),
    (
        "the closed leaves are left out of the bound",
        TREE,
        "bound = min(closed, heap",
        "bound = min(np.inf, heap",
    ),
    (
        "an almost solved node pays no penalty",
        CONIC,
        "                bound -= MAX_VALUE",
        "                bound -= 0.0 * MAX_VALUE",
    ),
    (
        "an almost solved node gains a penalty",
        CONIC,
        "                bound -= MAX_VALUE",
        "                bound += MAX_VALUE",
    ),
    ("the primal objective is the bound", CONIC, "answer.obj_val_dual + offset", "answer.obj_val + offset"),
    ("the margin is added", CONIC, "bound -= BOUND_MARGIN", "bound += BOUND_MARGIN"),
    (
        "an unfinished node counts as solved",
        CONIC,
        'in ("Solved", "AlmostSolved")',
        'in ("Solved", "AlmostSolved", "MaxIterations")',
    ),
    ("an unfinished node counts as infeasible", CONIC, 'status == "PrimalInfeasible"', 'status != "Solved"'),
    ("what is fixed costs nothing", CONIC, "data.offset + float(data.q @ fixed_x)", "data.offset"),
    (
        "rows without variables are not looked at",
        CONIC,
        "        or np.any(b[zero_end:cone_start][empty[zero_end:cone_start]] < -FEASIBILITY_TOLERANCE)\n",
        "",
    ),
    ("the caps of earlier groups are their bounds", BOUNDS, "[earlier.ceiling for", "[earlier.bound for"),
    (
        "a group is proven by the search bound",
        BOUNDS,
        "self._is_closed(index, group.objective, bound):\n            # The",
        "self._is_closed(index, group.objective, search_bound):\n            # The",
    ),
    ("strings are alike whatever their states", DATA, "same = same & (np.diff(values) == 0.0)", "same = same"),
    ("strings are alike whatever their limits", GROUP, " & _equal_rows(problem.limit_kw)", ""),
    ("frozen strings are exchanged", GROUP, " & (not frozen)", ""),
    ("a part is left out", TREE, "for part in branches():", "for part in branches()[:1]:"),
    ("a node without schedules has no bound at the cutoff", GROUP, "bound = min(answer.bound * self.unit, cutoff)", "bound = answer.bound * self.unit"),
    ("a string that has to run is off", GROUP, 'values[self._columns["on"]] = flag("must_run")', 'values[self._columns["on"]] = 0.0'),
    ("what may be shed is held at zero", GROUP, 'fixed[self._columns["a"][~sheds & (cells', 'fixed[self._columns["a"][True | (cells'),
    ("steps are cut as if nothing were shed", GROUP, "np.minimum(shed_kw.sum(axis=0), budget_kw)", "np.zeros(shed_kw.shape[1])"),
    ("the shed budget is halved", GROUP, "append(ceilings[g] / cost[g, :, 0].min()", "append(0.5 * ceilings[g] / cost[g, :, 0].min()"),
    ("ceilings of earlier groups are halved", GROUP, "ceilings[g] / units[g] if active", "0.5 * ceilings[g] / units[g] if active"),
    ("a node's bound is a per cent too high", GROUP, "min(answer.bound * self.unit, cutoff)", "min(1.01 * answer.bound * self.unit, cutoff)"),
    ("a closed gap reports the larger of bound and best", TREE, "TreeResult(reason, min(bound, best)", "TreeResult(reason, max(bound, best)"),
    ("at the node limit the best is the bound", TREE, "TreeResult(Termination.NODE_LIMIT, bound", "TreeResult(Termination.NODE_LIMIT, best"),
    ("the envelope is the upper hull", ENVELOPE, "if (y[k] - y[j]) * (x[i] - x[j]) < (y[i] - y[j])", "if (y[k] - y[j]) * (x[i] - x[j]) > (y[i] - y[j])"),
    ("the chord from above is the lowest", ENVELOPE, "float(np.max((y[1:] - y[0])", "float(np.min((y[1:] - y[0])"),
    ("a row on its cone is outside", CONIC, "rows[:, 0] + FEASIBILITY_TOLERANCE", "rows[:, 0] - FEASIBILITY_TOLERANCE"),
    ("every group is proven", BOUNDS, "within = objective - bound <=", "within = bound - objective <="),
    ("the rigorous bound counts the search's costs", BOUNDS, "ceilings, self._costs.reported, bound", "ceilings, self._costs.searched, bound"),
    ("earlier groups are held under their bounds", BOUNDS, "ceilings = [earlier.ceiling for", "ceilings = [earlier.bound for"),
    ("earlier groups of the search are held under their bounds", BOUNDS, "[earlier.search_ceiling for", "[earlier.search_bound for"),
]

RUST = [
    ("reach: charge is not rounded outwards", f"{REACH}/cell.rs", "const SOC_ROUNDING: f64 = 1e-12;", "const SOC_ROUNDING: f64 = -1e-6;"),
    ("reach: the coldest state is the warmest", f"{REACH}/cell.rs", "low: a.min(b) + rise * cell.heat_w.low", "low: a.max(b) + rise * cell.heat_w.high"),
    ("reach: heat at the wrong end of the scale", f"{REACH}/cell.rs", "heat(g_high, lowest(g_high)).max(heat(g_low, lowest(g_low)))", "heat(g_high, scale.high).max(heat(g_low, scale.high))"),
    ("reach: current at the wrong voltage", f"{REACH}/cell.rs", "root(g_high, v.low, r.high)", "root(g_high, v.high, r.high)"),
    ("reach: others take all of the demand", f"{REACH}/reachable.rs", "high: self.limit(m, t).min(self.demand_w[t])", "high: 0.5 * self.limit(m, t).min(self.demand_w[t])"),
    ("cuts: the bound is rounded up", f"{REACH}/step_bounds.rs", "unshed - ROUNDING * unshed.abs()", "unshed * 1.001"),
    ("cuts: the slope is halved", f"{REACH}/step_bounds.rs", "let bound = StepBound { phi: phi - ROUNDING * phi.abs(), shed_slope: slope };", "let bound = StepBound { phi: phi - ROUNDING * phi.abs(), shed_slope: 0.5 * slope };"),
    ("cuts: shedding costs nothing", f"{REACH}/step_bounds.rs", "        for curve in curves.iter_mut() {\n            curve.terms.shed_cost = slope;", "        for curve in curves.iter_mut() {\n            curve.terms.shed_cost = 2.0 * slope;"),
    ("least cost: more is shed than allowed", f"{REACH}/step_bounds.rs", "left_w -= shed_w;", ""),
    ("least cost: nothing is shed", f"{REACH}/step_bounds.rs", "used_up_w.min(max_w[t]).min(left_w)", "0.0 * used_up_w.min(max_w[t]).min(left_w)"),
    ("hull: the plane is not lifted", f"{REACH}/planes.rs", "corners.iter().map(offset).fold(f64::NEG_INFINITY, f64::max)", "corners.iter().map(offset).fold(f64::INFINITY, f64::min)"),
    ("hull: the derating line is not lowered", f"{REACH}/planes.rs", "fold(f64::INFINITY, f64::min);\n        Planes", "fold(f64::NEG_INFINITY, f64::max);\n        Planes"),
    ("bound tightening: values of the state are not paid back", f"{REACH}/bound_tightening/horizon_bound.rs", "horizon_bound.bound -= idle_value;", "horizon_bound.bound -= 0.5 * idle_value;"),
    ("bound tightening: warmth fades twice", f"{REACH}/bound_tightening/horizon_bound.rs", "idle_c = retained * idle_c + (1.0 - retained)", "idle_c = retained * retained * idle_c + (1.0 - retained)"),
    ("bound tightening: the constant of an inverter is left out", f"{REACH}/bound_tightening/horizon_bound.rs", "constant += costs.battery * self.operating.cells", "constant += 0.0 * costs.battery * self.operating.cells"),
    ("bound tightening: the constant goes with the least heat", f"{REACH}/bound_tightening/horizon_bound.rs", "self.operating.at(m, t)].heat_w.high;", "self.operating.at(m, t)].heat_w.low;"),
    ("bound tightening: charge at the wrong end of the voltage", f"{REACH}/bound_tightening/horizon_bound.rs", "Direction::Discharge => (-per_volt, [v.high, v.low])", "Direction::Discharge => (-per_volt, [v.low, v.high])"),
    ("bound tightening: shedding saves nothing", f"{REACH}/bound_tightening/mod.rs", "(horizon_bound.bound - horizon_bound.max_saving(shed_budget_w, cheapest_shed), horizon_bound)", "(horizon_bound.bound, horizon_bound)"),
    ("bound tightening: the slack is halved", f"{REACH}/bound_tightening/mod.rs", "let slack = cutoff - bound + ROUNDING * cutoff;", "let slack = 0.2 * (cutoff - bound);"),
    ("tightening: the price is left out", f"{REACH}/bound_tightening/tightening.rs", "bound: price * demand_w + parts.iter().sum::<f64>()", "bound: 1.01 * price * demand_w + parts.iter().sum::<f64>()"),
    ("tightening: a string is narrowed by half of its reach", f"{REACH}/bound_tightening/tightening.rs", "sum += with_slack.min(alone[t].high);", "sum += with_slack.min(0.5 * alone[t].high);"),
    ("certificate: the budget of the first group is its bound", f"{REACH}/certificate.rs", "budget_w.min(ceiling / cheapest)", "budget_w.min(0.0 * ceiling / cheapest)"),
    ("one step: pruned too early", f"{ONE_STEP}/solve.rs", "best.bound - GAP * best.bound.abs() || n_nodes == 0", "0.9 * best.bound || n_nodes == 0"),
    ("one step: what is set aside has no bound", f"{ONE_STEP}/solve.rs", "best.bound = best.bound.min(floor);", ""),
    ("one step: the number that runs is fixed", f"{ONE_STEP}/solve.rs", ".into_iter().enumerate() {", ".into_iter().enumerate().skip(curves.len()) {"),
    ("lagrangian: the demand is priced too high", f"{ONE_STEP}/lagrangian.rs", "bound: value + price * demand_w", "bound: value + 1.001 * price * demand_w"),
    ("curve: the scale is the dearest", f"{ONE_STEP}/cost_curve.rs", "(Scale::At(high), 0.0)\n        } else if middle < 0.0", "(Scale::At(low), 0.0)\n        } else if middle < 0.0"),
    ("curve: derating at its worst", f"{ONE_STEP}/cost_curve.rs", "(c_derating - price) / derating.high - c_derating;", "(c_derating - price) / derating.low.max(1e-3) - c_derating;"),
    ("ranges: the box is not cut at its knots", "rust/bess-control/src/model/ranges.rs", "socs.extend(states.soc.inside(ocv.x()));", ""),
    ("ranges: the scale is not that of the best corner", "rust/bess-control/src/model/ranges.rs", "out.power_scale_w.include(v.high * v.high / r.low);", "out.power_scale_w.include(v.low * v.low / r.low);"),
    ("reach: others can take less", f"{REACH}/reachable.rs", "let others = total - self.limit(m, t);", "let others = 0.5 * (total - self.limit(m, t));"),
    ("reach: the emptiest state was the fullest", f"{REACH}/cell.rs", "None => (states.soc.low + gained.low", "None => (states.soc.high + gained.low"),
    ("reach: a string that may be off is on", f"{REACH}/cell.rs", "(current.union(&Range::point(0.0)), 0.0)", "(current, 0.0)"),
    ("nodes: half of the demand is left to the others", f"{REACH}/node.rs", "self.demand_w[t] - others_low + slack_w", "0.5 * (self.demand_w[t] - others_low) + slack_w"),
    ("nodes: what others have to shed is left out", f"{REACH}/node.rs", "let others_w = min_w - cell.shed_w.low;", "let others_w = min_w;"),
    ("reach: heat by the smaller current", f"{REACH}/cell.rs", "(current.high * current.high).max(current.low * current.low)", "(current.high * current.high).min(current.low * current.low)"),
    ("reach: the weakest limit is the strongest", f"{REACH}/cell.rs", "low: power(v.low, r.high, fill_a.low.min(max_a.low))", "low: power(v.high, r.low, fill_a.low.min(max_a.low))"),
    ("reach: parts of a box are left out", f"{REACH}/cell.rs", "fold(Cell::NONE, |all, cell| all.union(&cell))", "fold(Cell::NONE, |_, cell| cell)"),
    ("least cost: shedding is paid twice", f"{REACH}/step_bounds.rs", "let saved = (shed_slope - shed_cost).max(0.0);", "let saved = (shed_slope - 2.0 * shed_cost).max(0.0);"),
    ("bound tightening: shedding saves half", f"{REACH}/bound_tightening/horizon_bound.rs", "max_saving += slope * shed_w;", "max_saving += 0.5 * slope * shed_w;"),
    ("bound tightening: heat pays the wrong way", f"{REACH}/bound_tightening/horizon_bound.rs", "if direction == Direction::Discharge { power_price } else { -power_price };", "if direction == Direction::Discharge { -power_price } else { power_price };"),
    ("bound tightening: what an inverter draws is a gain", f"{REACH}/bound_tightening/horizon_bound.rs", "constant -= (gained / usual - gained / other).abs() * drawn;", "constant += (gained / usual - gained / other).abs() * drawn;"),
    ("tightening: the oldest heat does not fade", f"{REACH}/bound_tightening/tightening.rs", "unheated_c - kept * cool[t + 1]", "unheated_c - cool[t + 1]"),
    ("tightening: without the slack", f"{REACH}/bound_tightening/tightening.rs", "let mut sum = self.slack / per_unit;", "let mut sum = 0.0;"),
    ("reach: least heat at the wrong end of the scale", f"{REACH}/cell.rs", "heat(g_low.min(0.25 * scale.high), scale.high) };", "heat(g_low.min(0.25 * scale.high), scale.low) };"),
    ("certificate: what may be shed is counted at the dearest string", f"{REACH}/step_bounds.rs", "map(|c| c.availability).fold(f64::INFINITY, f64::min)", "map(|c| c.availability).fold(0.0, f64::max)"),
    ("certificate: one step that sheds nothing is enough", f"{REACH}/certificate.rs", ".all(|flow| flow.availability_w <= 0.0)", ".any(|flow| flow.availability_w <= 0.0)"),
    ("priced: earlier groups are priced at more than is conceded", f"{REACH}/priced.rs", "*total += multiplier * cost", "*total += 4.0 * multiplier * cost"),
    ("priced: energies count as powers", f"{REACH}/priced.rs", "costs.map(|c| c / self.intervals[0].dt_h)", "costs.map(|c| c)"),
    ("lagrangian: strings that derate everything are left out", f"{ONE_STEP}/lagrangian.rs", "                total += off;\n", ""),
    ("plan bound: idle errors are not taken off", f"{PROOF}/mod.rs", "lerp(row, cell, share) - self.share * error(j)", "lerp(row, cell, share) - 0.0 * error(j)"),
    ("plan bound: errors of moves are not taken off", f"{PROOF}/mod.rs", "lerp(next_row, cell, share) - self.share * error)", "lerp(next_row, cell, share) - 0.0 * error)"),
    ("plan bound: prices exceed that of undelivered energy", f"{PROOF}/mod.rs", "l.min(c.availability)", "l.max(0.0 * c.availability)"),
    ("plan bound: smoothing raises values", f"{PROOF}/mod.rs", "*highest = larger(*highest, value - bend * (top - at) * (top - at))", "*highest = value - bend * (top - at) * (top - at)"),
    ("plan bound: heat of a product is free", f"{PROOF}/errors.rs", "step.costs.battery * error.heat_below_w", "0.0 * error.heat_below_w"),
    ("plan bound: internal power lies on the chord", f"{PROOF}/errors.rs", "+ step.steepest[j] * error.internal_w", "+ 0.0 * error.internal_w"),
    ("plan bound: delivered power has no kinks", f"{PROOF}/errors.rs", "larger(0.0, larger(step.bend[j].1 * error.convex_w, -step.bend[j].0 * error.concave_w))", "0.0"),
    ("plan bound: the derating factor is even", f"{PROOF}/errors.rs", "+ step.uneven[j] * error.max_power_w", ""),
    ("plan bound: deviations of heat have no value", f"{PROOF}/errors.rs", "step.rise * of_value", "0.0 * of_value"),
    ("plan bound: values have no kinks over temperature", f"{PROOF}/errors.rs", "+ step.rise * of_value + bend", "+ step.rise * of_value"),
    ("plan bound: slopes are equal at neighbouring SOC", f"{PROOF}/errors.rs", "+ 0.25 * error.heat_range_w * curvature.across(self, middle, image)", ""),
    ("plan bound: derated requests never pay", f"{PROOF}/errors.rs", "(-margin - k * (costs.availability - costs.derating).max(0.0)).max(0.0)", "0.0 * k"),
    ("plan bound: an inverter never draws its own loss", f"{PROOF}/mod.rs", "*e += gain(&of_off, cell).max(0.0)", "*e += 0.0 * gain(&of_off, cell)"),
    ("plan bound: an inverter that draws its own loss stops", f"{PROOF}/mod.rs", "if !errors.drawing.is_empty()", "if errors.drawing.len() == 1"),
    ("plan bound: all strings pay for their first start", f"{PROOF}/mod.rs", "values.of(problem.running[m])", "values.of(problem.running[m] && false)"),
    ("plan bound: a string that is off stays off", f"{PROOF}/mod.rs", "cap(&mut off, &running, self.problem.prices.start);", "let _ = &mut off;"),
    ("plan bound: boxes begin at requests of the coolest cell edge", f"{PROOF}/moves.rs", "min_w / self.factor[j].high", "min_w / self.factor[j].low"),
    ("plan bound: resistance is constant in a cell", f"{PROOF}/moves.rs", "let product_w = 0.5 *", "let product_w = 0.0 *"),
    ("plan bound: current squared lies on the chord", f"{PROOF}/moves.rs", "0.25 * bounds.resistance_ohm.high * current_a * current_a", "0.0 * bounds.resistance_ohm.high * current_a * current_a"),
    ("plan bound: resistance is bilinear in a cell", f"{PROOF}/moves.rs", "bounds.resistance_error_ohm.0 = bounds.resistance_error_ohm.0.max(-resistance)", "bounds.resistance_error_ohm.0 = 0.0 * resistance"),
    ("plan bound: a node counts the errors of one cell", f"{PROOF}/errors.rs", "larger(larger(at(i0, j0), at(i0, j1)), larger(at(i1, j0), at(i1, j1)))", "at(i0, j0)"),
    ("plan bound: boxes that end with a current have no errors", f"{PROOF}/mod.rs", "larger(below[j], above[j])", "larger(f64::NEG_INFINITY, above[j])"),
]
# fmt: on

TESTS = {
    "python": [
        [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
        + [
            f"tests/split/{name}.py"
            for name in (
                "test_tree",
                "test_branch_and_bound",
                "test_parts",
                "test_relaxation",
                "test_bounds",
                "test_containment",
                "test_properties",
            )
        ],
    ],
    "rust": [["cargo", "test", "--locked", "-q", "-p", "bess-control"]],
}


def applies(mutation: tuple[str, str, str, str]) -> bool:
    """Whether the line that a mutation changes is still there."""
    _, path, before, _ = mutation
    return before in (ROOT / path).read_text(encoding="utf-8")


def survives(copy: Path, kind: str, path: str, before: str, after: str) -> bool:
    """Apply one mutation, run the tests, take it back."""
    file = copy / path
    source = file.read_text(encoding="utf-8")
    file.write_text(source.replace(before, after, 1), encoding="utf-8")
    try:
        return all(
            subprocess.run(
                command, cwd=copy, capture_output=True, check=False, env=environment(copy)
            ).returncode
            == 0
            for command in TESTS[kind]
        )
    finally:
        file.write_text(source, encoding="utf-8")


def environment(copy: Path) -> dict[str, str]:
    """The copy's Python sources come first; its own folder for what Cargo builds."""
    return os.environ | {"PYTHONPATH": str(copy / "python"), "CARGO_TARGET_DIR": str(copy / "target")}


def main(kinds: list[str]) -> int:
    """Try every mutation; return how many survive."""
    stale = [name for name, *rest in PYTHON + RUST if not applies((name, *rest))]
    if stale:
        raise SystemExit(f"change the list of mutations: the lines of these are gone: {', '.join(stale)}")
    survivors = tried = 0
    with tempfile.TemporaryDirectory(prefix="bess-mutations-") as scratch:
        copy = Path(scratch) / "bess"
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".venv", "target", ".git", "results"))
        for kind, mutations in (("python", PYTHON), ("rust", RUST)):
            for name, path, before, after in mutations if kind in kinds else []:
                tried += 1
                alive = survives(copy, kind, path, before, after)
                survivors += alive
                print(f"{'SURVIVES' if alive else 'killed  '} {kind}: {name}", flush=True)
    print(f"{tried - survivors} of {tried} killed")
    return survivors


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or ["python", "rust"]))
