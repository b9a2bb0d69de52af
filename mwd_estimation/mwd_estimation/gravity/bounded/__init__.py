"""The default gravity method: an error-state filter bounded by the tool's small velocity."""
