"""Ask the bridge for readings: the client that all nodes share, and read_tag."""
