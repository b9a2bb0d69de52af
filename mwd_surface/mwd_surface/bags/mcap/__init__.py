"""MCAP files: format, index, writer, recovery."""
