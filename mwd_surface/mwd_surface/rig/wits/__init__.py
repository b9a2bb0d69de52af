"""WITS level 0."""
