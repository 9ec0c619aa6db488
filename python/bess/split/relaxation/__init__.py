"""The convex relaxation of the power split: equations in CVXPY, their data, compiled once, and its nodes."""
