"""The magnetic field: corrections, spikes, the string's own field."""
