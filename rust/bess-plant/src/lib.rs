//! Electro-thermal plant of a battery of parallel strings.
