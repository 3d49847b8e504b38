"""The process of a node: signals and exit, parameters, running, security."""
