"""The convex relaxation of the power split: equations in CVXPY, compiled data, and nodes of the tree."""
