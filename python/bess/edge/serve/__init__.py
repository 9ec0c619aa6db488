"""The service: a controller that is called over HTTP, or controls a plant itself."""
