"""One file for each contender; each prints one JSON line with its CPU time."""
