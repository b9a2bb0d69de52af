"""The simulated sonde: scenario, motion, vibration, instruments, interference, faults."""
