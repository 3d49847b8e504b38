# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Ask the bridge for readings: the client that all nodes share, and read_tag."""
