//! Potential of a graphite anode, after Safari and Delacourt (J. Electrochem. Soc. 158 (2011) A562).

/// Potential against lithium [V] at a state of charge of the cell; its stoichiometry runs from 0.0085 to 0.78.
pub(crate) fn potential_v(soc: f64) -> f64 {
    let x = 0.0085 + soc * 0.7715;
    0.6379 + 0.5416 * (-305.5309 * x).exp()
        - 0.044 * ((x - 0.1958) / 0.1088).tanh()
        - 0.1978 * ((x - 1.0571) / 0.0854).tanh()
        - 0.6875 * ((x + 0.0117) / 0.0529).tanh()
        - 0.0175 * ((x - 0.5692) / 0.0875).tanh()
}
