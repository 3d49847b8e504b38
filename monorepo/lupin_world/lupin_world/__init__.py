"""Make an SDF world of the greenhouse from the layout that the bridge serves."""
