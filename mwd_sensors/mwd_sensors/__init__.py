"""What the tool feels: frames, earth, instruments, drilling dynamics, scenarios and the simulated sonde."""

__version__ = "0.1.0"
