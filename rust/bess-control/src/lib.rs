//! Discrete-time control model of a battery of parallel strings.
