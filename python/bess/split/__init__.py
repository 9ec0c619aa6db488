"""Power split: objectives, relaxation, branch and bound, and the control model it decides with (MODEL.md 3,
4)."""
