"""Results as charts: each function only selects and arranges data; drawing is elsewhere."""
