"""The service: a controller that a plant can call, or that drives a plant by itself."""
