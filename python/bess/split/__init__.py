"""Power split: objectives, search and certificate; told on one page in docs/algorithm.md."""
