"""The nodes of this package, and the parts the surface node is made of."""
