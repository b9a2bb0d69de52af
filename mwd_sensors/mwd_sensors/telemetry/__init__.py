"""The air interface between tool and surface: words, sequences, pulse codes, serial frames. Both ends import it."""
