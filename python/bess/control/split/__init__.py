"""Power split: objectives, search and certificate (docs/algorithm.md)."""
