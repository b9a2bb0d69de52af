"""What the tool knows: gravity while drilling, attitude, north, magnetic interference, quality, uncertainty."""

__version__ = "0.1.0"
