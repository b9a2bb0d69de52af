"""The crash-proof recorder."""
