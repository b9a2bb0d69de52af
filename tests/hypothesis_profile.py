"""Plugin of the gate: property tests give the same answer each time and no verdict on the machine's speed."""

from hypothesis import settings

settings.register_profile("gate", deadline=None, derandomize=True)
settings.load_profile("gate")
