"""Software at a plant: the service, links to devices, and distilled controllers."""
