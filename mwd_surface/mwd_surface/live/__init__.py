"""The live state of the well, which the page and the rig outputs read."""
