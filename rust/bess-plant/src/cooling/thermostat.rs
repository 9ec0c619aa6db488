//! Thermostat of a string: stages of flow over its mean temperature, as shares of the full flow.

use bess_tables::Cooling;

pub(super) fn max_stages(cooling: &Cooling) -> usize {
    if cooling.variable_flow {
        1
    } else {
        cooling.flow_steps.len()
    }
}

/// Stages of flow that are on, from their previous number: stage `i` starts at `start + i step` and stops a dead band below.
pub(super) fn stages(cooling: &Cooling, before: u8, mean_c: f64) -> u8 {
    let most = max_stages(cooling) as u8;
    let Some(start_c) = cooling.start_c else { return most };
    let begins_c = |stage: u8| start_c + f64::from(stage) * cooling.step_k;
    let mut on = before.min(most);
    while on < most && mean_c > begins_c(on) {
        on += 1;
    }
    while on > 0 && mean_c < begins_c(on - 1) - cooling.dead_band_k {
        on -= 1;
    }
    on
}

pub(super) fn share(cooling: &Cooling, stages: u8, mean_c: f64) -> f64 {
    let steps = &cooling.flow_steps;
    match (stages, cooling.start_c) {
        (0, _) => 0.0,
        (_, Some(start_c)) if cooling.variable_flow => {
            let ends_c = start_c - cooling.dead_band_k;
            let place = (mean_c - ends_c) / (start_c + cooling.step_k - ends_c);
            steps[0] + (1.0 - steps[0]) * place.clamp(0.0, 1.0)
        }
        _ => steps[usize::from(stages) - 1],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::common;

    #[test]
    fn stages_begin_one_step_apart_and_end_a_dead_band_below() {
        let mut cooling = common::cooling("liquid");
        (cooling.start_c, cooling.dead_band_k, cooling.step_k) = (Some(30.0), 5.0, 2.0);
        cooling.flow_steps = vec![0.4, 1.0];
        let mut on = 0;
        let mut seen = Vec::new();
        for mean_c in [29.9, 30.0, 30.1, 32.0, 32.1, 27.1, 26.9, 25.0, 24.9, 26.0, 40.0, 20.0] {
            on = stages(&cooling, on, mean_c);
            seen.push(on);
        }
        assert_eq!(seen, [0, 0, 1, 1, 2, 2, 1, 1, 0, 0, 2, 0]);
    }

    #[test]
    fn a_variable_flow_rises_linearly_from_minimum_to_full() {
        let mut cooling = common::cooling("liquid");
        (cooling.start_c, cooling.dead_band_k, cooling.step_k) = (Some(30.0), 5.0, 5.0);
        (cooling.flow_steps, cooling.variable_flow) = (vec![0.2], true);
        assert_eq!(stages(&cooling, 0, 30.0), 0);
        assert_eq!(stages(&cooling, 1, 26.0), 1);
        let at = |mean_c| share(&cooling, 1, mean_c);
        assert!((at(25.0) - 0.2).abs() < 1e-12 && (at(30.0) - 0.6).abs() < 1e-12);
        assert!((at(35.0) - 1.0).abs() < 1e-12 && (at(50.0) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn without_a_start_the_coolant_always_flows() {
        let mut cooling = common::cooling("air");
        cooling.start_c = None;
        assert_eq!(share(&cooling, stages(&cooling, 0, -40.0), -40.0), 1.0);
    }
}
